"""Replay: what a bag has, published as it was recorded."""
