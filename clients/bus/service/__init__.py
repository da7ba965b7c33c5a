"""Services: a server and a client, each loaded only by programs that use it.

    client                                      server
    publisher  of <service>_request  -------->  subscription
    subscription to <service>_reply  <--------  publisher

Both topics are hidden. `base.py` makes and closes the two endpoints of either end. `bus.types.service` has
the envelopes, which name the call of a reply.

Invariants:

- A client declares its subscription before its publisher; a server declares its publisher first. So when a
  request arrives, its client can already receive the reply.
- A call ends with one reply or one error. If its server leaves, or busd loses the call, that is an error.
  There is no limit of time: a server may take as long as it likes.
- The types of both topics carry a digest of the whole definition, so a client never matches a server with a
  different definition.

Read first: `base.py`, then `client.py`.

Tests: `tests/system/test_services.py`, `tests/system/test_service_faults.py`,
`tests/system/test_hostile_services.py`, `tests/unit/bus/types/test_service.py`.
"""
