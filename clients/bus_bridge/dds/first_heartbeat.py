"""Heartbeats for readers of cyclonedds before a far writer's first sample.

A volatile reader of Cyclone begins after the last number in the first heartbeat of a writer of another vendor
(`ddsi_proxy_writer_add_connection`, `handle_Heartbeat`). It takes earlier samples only if they arrived whole
before that heartbeat. Fast DDS sends none at a match, and Cyclone's questions before the first heartbeat do
not get one. So the first heartbeat comes among the fragments of the first long sample, and Cyclone drops that
sample. A question that Fast DDS answers (`ask_for_heartbeat` of an RTPS participant) makes the first
heartbeat come before the first sample.
"""

import asyncio
from collections.abc import Callable
from typing import Final

from bus_bridge.rtps.policies import Policies

__all__ = ["FirstHeartbeats"]

_PAUSES_S: Final = (0.0, 0.005, 0.02, 0.1, 0.5, 2.0)
"""Before each question. A writer that does not know the reader yet ignores it. After an answered one, further
ones have no effect."""


class FirstHeartbeats:
    """Questions for first heartbeats. `ask` gets the GUIDs of a reader of ours and of a far writer."""

    def __init__(self, ask: Callable[[bytes, bytes], None]) -> None:
        self._ask = ask
        self._loop = asyncio.get_running_loop()

    def matched(self, reader: bytes, policies: Policies, writer: bytes) -> None:
        """A reader has a new match."""
        if policies.reliable and not policies.transient_local:
            self._later(reader, writer, 0)

    def _later(self, reader: bytes, writer: bytes, step: int) -> None:
        if step < len(_PAUSES_S):
            self._loop.call_later(_PAUSES_S[step], self._again, reader, writer, step)

    def _again(self, reader: bytes, writer: bytes, step: int) -> None:
        self._ask(reader, writer)
        self._later(reader, writer, step + 1)
