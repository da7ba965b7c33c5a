"""Checks that the tests find faults: breaks lines of the source, one at a time.

mutants.toml lists the lines as data; `make mutants` (`python -m mutants`) tries each in a copy of the tree.
"""
