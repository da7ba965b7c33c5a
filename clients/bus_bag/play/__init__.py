"""Replay: messages of a bag, published at the times at which they were recorded.

    files -> `read_ahead.py` (a thread: reads, decodes) -> queue -> `player.py` -> publishers (`topics.py`)
                                        `time_line.py`: when is a message due? -^

Which topics: `selection.py`; with which QoS: `qos.py`; what late joiners would have got: `latched.py`;
commands: `keys.py`, `services.py`, `seek.py`; waiting: `alarm.py`; all put together: `program.py`.

Invariants:

- The replay changes its state only by the table in `state.py`. Whether it is paused belongs to the time line.
- When a message is due follows from one point of the time line and the rate, so the replay does not drift.
- All state is changed on the event loop, so there are no locks. The thread and the loop each write their own
  part of the queue.
- The queue is bounded in messages and bytes.
- A replay from the middle first publishes the latched state of that moment.

Read first: `state.py`, `time_line.py`, `player.py`.

Tests: `tests/unit/bus_bag/play/`, `tests/system/test_bag_play.py`, `tests/system/test_bag_keys.py`.
"""
