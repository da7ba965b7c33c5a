"""The command-line tool `bus`: one module a verb, imported when it is chosen."""
