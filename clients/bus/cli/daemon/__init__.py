"""Verbs of `bus daemon`."""
