"""Verbs of `bus action`."""
