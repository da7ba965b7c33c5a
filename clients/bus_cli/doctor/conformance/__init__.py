"""`bus doctor --conformance -- ./client`: whether a client in another language keeps to the protocol.

Starts the client once for each story, with a separate broker that plays the story and no other clients.

- `conversation.py`: the rules for one connection: the answers of busd, and the mistakes of the client
- `payloads.py`: messages of any type
- `client.py`: the client's process
- `stage.py`: the socket and the connections of a busd that only tests
- `stories.py`: the stories
- `services.py`: the stories about services
- `real.py`: the stories with a real busd, and their stage
- `program.py`: plays the stories and prints the outcomes
- `options.py`: the options, which `bus doctor` has without these modules

Invariants:

- `conversation.py` and `payloads.py` have no I/O and no clock.
- A text about a mistake names the thing, its value and the right value.
- Nothing waits longer than the limit, and no client survives its story.

Read first: `conversation.py`, docs/conformance.md. Tests: `tests/unit/bus_cli/doctor/conformance/`,
`tests/system/test_conformance.py`.
"""
