"""Programs that ask too much of busd, all the time, as fast as it goes: the neighbours of fairness.

    python -m benchmarks.adapters.hostile <Attack as JSON>

speaks the protocol of benchmarks.harness: says `ready` when it floods, and on the word `report` `flooded`
with what it did since then: `asked`, and `refused` of these. A client that is cut off connects again.

`attack` is what it is told, `raw` how it speaks to busd, `pump` how it does so on many connections; the
floods are in `load` (busd is not asked), `frames`, `coming` and `crowding`.
"""
