"""Warnings about what goes wrong at run time, as many as a log can bear."""
