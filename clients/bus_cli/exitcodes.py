"""Exit codes of the program `bus`. A code below zero is minus the number of the signal to die by."""

__all__ = ["EXIT_ERROR", "EXIT_USAGE"]

EXIT_ERROR = 1
EXIT_USAGE = 2
