"""The exit codes of the program `bus`. Those of programs that `bus run` runs are `bus.launching`'s."""

__all__ = ["EXIT_ERROR", "EXIT_INTERRUPTED", "EXIT_TERMINATED", "EXIT_USAGE"]

EXIT_ERROR = 1
EXIT_USAGE = 2
EXIT_INTERRUPTED = 2
"""After Ctrl-C: SIGINT's number, as ros2 has it."""
EXIT_TERMINATED = 15
"""After SIGTERM: its number."""
