"""Replay: publishes the messages of a bag at the times at which they were recorded.

    files -> `read_ahead.py` (a thread: reads, decodes) -> queue -> `player.py` -> publishers (`topics.py`)
                                        `time_line.py`: when is a message due? -^

`selection.py` chooses topics, `qos.py` their QoS. `gaps.py` has the texts about long gaps. `latched.py` has
the messages that late joiners would have received. `requests.py` sends the requests of recorded calls.
Commands: `keys.py`, `services.py`, `seek.py`. Waiting: `alarm.py`. `program.py` connects all parts.

Invariants:

- The replay changes its state only by the table in `state.py`. The time line knows whether it is paused.
- The due time of a message follows from one point of the time line and the rate, so the replay does not
  drift.
- Only the event loop changes state, so there are no locks. The thread and the loop each write their own part
  of the queue.
- The queue is limited in messages and bytes.
- A replay from the middle first publishes the latched state of that moment.

Read first: `state.py`, `time_line.py`, `player.py`.

Tests: `tests/unit/bus_bag/play/`, `tests/system/test_bag_play.py`, `tests/system/test_bag_keys.py`,
`tests/system/test_bag_requests.py`.
"""
