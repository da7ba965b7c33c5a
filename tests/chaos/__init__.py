"""Processes on a bus that are killed, stopped, cut off and starved at random, and what must hold meanwhile.

`roles` are values, `plan` says what happens when (pure), `actor` is the processes, `proxy` cuts connections,
`stage` starts and questions them, `director` does what the plan says, `judge` says what is wrong (pure),
`report` what was done.
"""
