"""The verbs of `bus tf2`: the programs of tf2 under short names."""
