"""Verbs of `bus topic`."""
