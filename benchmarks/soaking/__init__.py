"""What `make soak` is made of: the load, what is counted and sampled, and what is made of it.

`benchmarks/soak.py` puts it together.
"""
