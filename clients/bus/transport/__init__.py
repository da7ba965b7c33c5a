"""Bytes between processes, on the event loop."""
