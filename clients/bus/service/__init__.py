"""Services: the two ends, each loaded only by programs that have one, and what both have in common."""
