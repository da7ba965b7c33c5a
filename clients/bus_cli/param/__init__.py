"""Verbs of `bus param`."""
