"""Verbs of `bus node`."""
