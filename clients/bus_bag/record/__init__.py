"""Recording: messages of the topics of the bus, written into a bag.

    graph --> `discovery.py`, `choice.py` --> `topic.py` (a subscription for each topic)
                                                  |
                             `intake.py` takes messages as they arrive
                                                  |
         `pipeline.py`: `cache.py` -> `bag_output.py` (encoded, split) -> `writing.py` (a thread) -> files

`state.py` has the states of a recording as a table, `recorder.py` acts on them, `program.py` adds signals,
keys and the terminal.

Invariants:

- Taking comes before writing. The event loop never waits for the disk: what the thread can't take yet waits
  in the cache, which is bounded.
- If the cache is full, the topic with the most waiting bytes loses its oldest messages. Each loss is counted.
- A lossless topic is not taken while the pipeline is crowded, so its publishers wait and nothing is lost.
- Only jobs run in the thread, one at a time, in order. Everything else runs on the event loop.
- Whatever ends a recording, the bag is closed with all that was written; only a second stop drops messages.
- Each further file begins with the latched messages, so that it can be played alone.

Read first: `state.py`, `recorder.py`, `pipeline.py`.

Tests: `tests/unit/bus_bag/record/`, `tests/system/test_bag_recorder.py`, `tests/system/test_bag_record.py`.
"""
