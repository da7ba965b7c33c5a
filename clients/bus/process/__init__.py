"""What a process has, bus or not: arguments, signals, a log file, the loop that threads share."""
