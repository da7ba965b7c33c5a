"""Recording: writes messages of topics of the bus into a bag.

    graph --> `discovery.py`, `choice.py` --> `topic.py` (a subscription for each topic)
                                                  |
                             `intake.py` takes messages as they arrive
                                                  |
         `pipeline.py`: `cache.py` -> `bag_output.py` (encoded, split) -> `writing.py` (a thread) -> files

`state.py` has the states of a recording as a table. `recorder.py` acts on them. `program.py` adds signals,
keys and the terminal.

Invariants:

- Taking messages has priority over writing. The event loop never waits for the disk: messages that the thread
  can't accept yet wait in the cache, which has a size limit.
- If the cache is full, the topic with the most waiting bytes loses its oldest messages. Each loss is counted.
- While the pipeline is crowded, messages of lossless topics are not taken. So their publishers wait, and no
  message is lost: messages already taken stay in the cache, if need be above its limit.
- Only jobs run in the thread, one at a time, in order. Everything else runs on the event loop.
- Every end of a recording closes the bag with everything written. Only a second stop drops messages.
- Each further file begins with the latched messages, so it can be played alone.

Read first: `state.py`, `recorder.py`, `pipeline.py`.

Tests: `tests/unit/bus_bag/record/`, `tests/system/test_bag_recorder.py`, `tests/system/test_bag_record.py`.
"""
