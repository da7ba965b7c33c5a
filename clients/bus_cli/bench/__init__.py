"""Verbs of `bus bench`, and the processes that they measure with."""
