"""What busd costs and how fast it is, as ratios measured side by side in one run: `python -m benchmarks`."""
