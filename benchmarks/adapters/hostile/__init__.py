"""Programs that overload busd all the time at full speed: the neighbours of the fairness benchmark.

    python -m benchmarks.adapters.hostile <Attack as JSON>

uses the protocol of benchmarks.harness. It says `ready` when it floods. On the word `report` it says
`flooded` with its counters since then: `asked`, and `refused` of these. A client that busd disconnects
connects again.

`attack` has the description of the task. `raw` is a client of busd, and `pump` drives many connections. The
floods are in `load` (it asks nothing of busd), `frames`, `coming` and `crowding`.
"""
