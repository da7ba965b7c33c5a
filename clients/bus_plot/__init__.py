"""Losses over time, and drawings of numbers over time.

    times --> `histogram.py` (counts, quantiles, lines)
    counters --> `loss_timeline.py` (when, how many, by which reason) --+-- `bars.py` (a line of text)
                                                                        +-- `strips.py` (several topics)

Invariants:

- Pure: times come in as arguments. A caller chooses the clock.
- A timeline has a bound, and no loss leaves it: old losses only become less exact in time.
- Texts of other programs, such as topic names, are escaped in pictures.

`bus top`, the page, bags and the soak use it. Read first: `loss_timeline.py`. Tests: `tests/unit/bus_plot/`.
"""
