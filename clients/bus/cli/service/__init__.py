"""Verbs of `bus service`."""
