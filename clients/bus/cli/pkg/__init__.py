"""Verbs of `bus pkg`."""
