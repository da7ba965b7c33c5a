"""busd.server.requests: the answers to a request for a restart or a reload."""

import asyncio
import logging
from collections.abc import Awaitable, Callable

import pytest

from bus.base.ids import PeerId
from bus.errors import ConfigurationError
from bus.wire.messages import Done, Message, Refused
from busd.core.effects import Restart
from busd.server.requests import Requests
from semantics import until

PEER = PeerId(1)
ASKED = Restart(PEER, 7, "asked")


class Host:
    def __init__(self) -> None:
        self.is_ending = False
        self.said: list[Message | str] = []

    def answer(self, peer: PeerId, answer: Message) -> None:
        assert peer is PEER
        self.said.append(answer)

    def restart(self, reason: str) -> None:
        self.said.append(f"restart: {reason}")


async def said(find_fault: Callable[[], Awaitable[str]] | None, host: Host) -> list[Message | str]:
    """The messages after a request for a restart."""
    Requests(host, find_fault, None).restart(ASKED)
    await until(lambda: host.said)
    return host.said


class TestRestart:
    async def test_is_answered_first(self) -> None:
        async def find_fault() -> str:
            return ""

        assert await said(find_fault, Host()) == [Done(request=7), "restart: asked"]

    async def test_where_something_speaks_against_it(self, caplog: pytest.LogCaptureFixture) -> None:
        async def find_fault() -> str:
            return "no such file"

        assert await said(find_fault, Host()) == [Refused(request=7, text="no such file")]
        assert [(one.levelno, one.message) for one in caplog.records] == [
            (logging.ERROR, "no restart: no such file")
        ]

    async def test_of_one_that_can_not(self) -> None:
        assert await said(None, Host()) == [Refused(request=7, text="this busd can't restart")]

    async def test_of_one_that_ends(self) -> None:
        async def find_fault() -> str:
            raise AssertionError

        host = Host()
        host.is_ending = True
        assert await said(find_fault, host) == [Refused(request=7, text="busd is stopping")]

    async def test_one_at_a_time(self) -> None:
        """A second request during the check of the reasons is refused. A later one is not."""
        check = asyncio.Event()

        async def find_fault() -> str:
            await check.wait()
            return "wait"

        host = Host()
        requests = Requests(host, find_fault, None)
        for _ in range(2):
            requests.restart(ASKED)
        for _ in range(5):
            await asyncio.sleep(0)
        assert host.said == [Refused(request=7, text="busd is stopping")]
        check.set()
        await until(lambda: len(host.said) == 2)
        requests.restart(ASKED)
        await until(lambda: len(host.said) == 3)
        assert host.said[1:] == [Refused(request=7, text="wait")] * 2


class TestReload:
    @pytest.mark.parametrize("text", ["", "limits.connections"])
    async def test_says_what_has_changed(self, text: str) -> None:
        host = Host()
        Requests(host, None, lambda: text).reload(PEER, 3)
        assert host.said == []  # not while effects are carried out
        await until(lambda: host.said)
        assert host.said == [Done(request=3, text=text)]

    async def test_says_what_is_wrong(self) -> None:
        def reload() -> str:
            raise ConfigurationError("line 3")

        host = Host()
        Requests(host, None, reload).reload(PEER, 3)
        await until(lambda: host.said)
        assert host.said == [Refused(request=3, text="line 3")]

    async def test_without_a_configuration(self) -> None:
        host = Host()
        Requests(host, None, None).reload(PEER, 3)
        await until(lambda: host.said)
        assert host.said == [Done(request=3, text="")]
