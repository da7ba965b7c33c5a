"""What of both buses is mirrored and carried, by which rules, and what becomes of each message."""
