"""The systems that are measured, each as the program that its processes run.

    python -m benchmarks.adapters.<system> publisher|subscriber|relay <Work as JSON>

speaks the protocol of benchmarks.harness. What its roles say and obey (`roles` does it for most of them):

    subscriber  says `ready` when nothing that is published later will be missed. Flood: says `warm` when it
                has the warm-up, and `received` with `count` and `dropped` when it has the rest. Paced: says
                `complete` when it has all, and on the word `report` `received` with `late_ns` and `age_ns`
                (`work.Arrivals`).
    publisher   says `ready` when it reaches the subscriber, with its `route` if it has several. Flood:
                publishes the warm-up on the word `warm_up` and the rest on the word `go`, then says `sent`
                with `begin_ns`. Paced: does `work.pace` on the word `go`.
    relay       a server of the system's own, if it has one: says `ready` when it serves.
"""
