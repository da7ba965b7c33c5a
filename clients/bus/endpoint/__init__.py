"""The internal part of publishers and subscriptions, used by the link and delivery.

    user's object (`bus.publisher`, `bus.subscription`)   methods for users
        |  holds
    core (`publisher_core.py`, `subscription_core.py`)    number at busd, matches, control messages, end
        |  uses
    `bus.delivery` (samples), `bus.link` (declaration, requests)

`core.py` is the base of both cores. `endpoint.py` has the methods that both kinds of endpoint offer to users.
`matches.py`, `incompatible.py`, `deadline.py`, `acknowledging.py`, `arrivals.py` and `liveliness.py` each do
one job of a core.

Invariants:

- A core does not know the user's object. References go down only.
- `gid` names an endpoint for its whole life. `id` is busd's number: 0 while busd does not know the endpoint,
  and another one after each reconnection.
- Control messages about an endpoint arrive in its core's `handle`. A new message from busd needs a branch
  there.
- Modules that few endpoints need (`deadline.py`, `incompatible.py`) are imported late: the start of a program
  pays for each import.

Read first: `core.py`, then `subscription_core.py`.

Tests: `tests/unit/bus/endpoint/`, `tests/unit/bus/delivery/` (endpoints in one process),
`tests/system/test_delivery.py`, `tests/system/test_events.py`, `tests/system/test_missed.py`,
`tests/system/test_statistics.py`.
"""
