"""An actor that leaves in order in the middle of a storm, while the director continues."""

import contextlib
import os
import select

from chaos.stage import Actor, Gone


class Leaver:
    """Makes the actor hand over everything and end. `witnesses` are as in judge.Said, once that `is_seen`."""

    def __init__(self, actor: Actor) -> None:
        self.name = actor.role.name
        self.is_seen = False
        self.witnesses: frozenset[str] = frozenset()
        self._exit = os.pidfd_open(actor.pid)
        with contextlib.suppress(Gone):
            actor.order("rest")
        actor.leave()

    def has_ended(self) -> bool:
        return bool(select.select([self._exit], [], [], 0)[0])

    def close(self) -> None:
        os.close(self._exit)
