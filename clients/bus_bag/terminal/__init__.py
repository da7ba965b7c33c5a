"""The terminal of a recorder or player: its keys, and a line below the log."""
