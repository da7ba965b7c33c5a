"""The measured systems. Each module is the program that the processes of one system run.

    python -m benchmarks.adapters.<system> publisher|subscriber|relay <Work as JSON>

uses the protocol of benchmarks.harness. These are the events and words of its roles (`roles` handles most of
them):

    subscriber  Says `ready` when it will not miss any later message.
                Flood: says `warm` when it has the warm-up, and `received` with `count` and `dropped` when it
                has the rest.
                Paced: says `complete` when it has all messages. On the word `report` it says `received` with
                `late_ns` and `age_ns` (`work.Arrivals`).
    publisher   Says `ready` when it reaches the subscriber, with its `route` if it has several.
                Flood: publishes the warm-up on the word `warm_up` and the rest on the word `go`, then says
                `sent` with `begin_ns`.
                Paced: does `work.pace` on the word `go`.
    relay       A server that belongs to the system, if there is one: says `ready` when it serves.
"""
