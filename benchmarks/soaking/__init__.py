"""The parts of `make soak`: the load, its counters and samples, and their evaluation.

`benchmarks/soak.py` connects them.
"""
