"""Verbs of `bus lifecycle`."""
