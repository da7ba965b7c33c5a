"""The exit codes of the program `bus`. One below zero stands for the signal that ends it."""

__all__ = ["EXIT_ERROR", "EXIT_USAGE"]

EXIT_ERROR = 1
EXIT_USAGE = 2
