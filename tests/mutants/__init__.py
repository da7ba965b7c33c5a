"""Whether the tests see what they are there for: lines of the source, broken one at a time.

mutants.toml has them as data; `make mutants` (`python -m mutants`) tries each in a copy of the tree.
"""
