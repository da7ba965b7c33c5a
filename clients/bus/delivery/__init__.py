"""Delivery of samples: out of a publisher and into a subscription, by shared memory and by socket.

    publisher                                           subscription
    `sender.py` --+-- `shm_sender.py`  ==> ring ==>  `shm_receiver.py` --+-- `receiver.py` -- `dispatcher.py`
                  +-- `socket_sender.py` -> busd ->  the link  ----------+   (queue)          (callbacks)

Helpers of the publisher: the run that it fills (`open_run.py`), samples of other threads (`thread_queue.py`),
the credit of lossless publishers (`window.py`), the subscriptions that they wait for (`recipients.py`), the
size of the ring (`ring_size.py`), loans (`lending.py`). Helpers of the subscription: the numbers of samples
(`sequence.py`), counters (`counters.py`), ages of messages (`ages.py`). Helper of both: the bound of queues
(`allowance.py`). `match.py` has the states of a match by shared memory at both ends, as tables.

Invariants:

- No asyncio, no event loop, no socket. All output, waiting and timers go through a `Port` (`port.py`). The
  link is the port; tests use `tests/world/list_port.py`. import-linter checks this.
- One publisher has one sequence of numbers, whatever the route. A number is received at most once, and each
  missing number is counted once, with a reason.
- The order per publisher stays, even if the ring grows or the route changes.
- A sender knows encoded samples, not messages.
- The state of a match by shared memory changes only by its table.
- A message takes no more Python calls, bytecodes or allocations than `tests/system/test_steps.py` allows. The
  native core (`bus.shm`) does most of the work for a plain message; this package handles the other cases.

Read first: `port.py`, then `sender.py` and `receiver.py`. docs/architecture.md, "Life of a message", names
the native parts.

Tests: `tests/unit/bus/delivery/`; with a broker, but without sockets: `tests/property/test_whole_bus.py`; by
both routes between processes: `tests/system/test_delivery.py`, `tests/system/test_routes.py`.
"""
