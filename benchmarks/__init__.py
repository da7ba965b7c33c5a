"""Costs and speed of busd, as ratios measured side by side in one run: `python -m benchmarks`."""
