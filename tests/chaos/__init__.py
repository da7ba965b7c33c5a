"""Processes on a bus that are killed, stopped, cut off and starved at random, and invariants meanwhile.

`roles` has values, `plan` the times of all events (pure), `actor` the processes. `proxy` cuts connections,
`stage` starts and questions actors, `director` carries out the plan, `judge` finds violations (pure),
`report` has totals.
"""
