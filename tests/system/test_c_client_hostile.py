"""The C client and a hostile busd: no message, run or memory makes it crash, hang or leak."""

import asyncio
import signal
from pathlib import Path

import pytest

import c_programs
from c_hostile import HostileBusd
from programs import on_one_loop

CONNECTIONS = 40
FRAMES = 60


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


@on_one_loop
@pytest.mark.parametrize("seed", range(3))
async def test_nonsense_does_no_harm(programs: Path, tmp_path: Path, socket_path: Path, seed: int) -> None:
    options = (("keep_all",), ("latched", "watch"), ("depth=3", "watch"))[seed]
    busd = HostileBusd(socket_path, seed, requests=3 + ("watch" in options))
    try:
        serving = asyncio.create_task(asyncio.to_thread(busd.serve, CONNECTIONS, FRAMES))
        async with c_programs.peer(programs, tmp_path, "relay", "/t", "/back", *options) as peer:
            busd.may_begin.set()
            await serving
            peer.program.process.send_signal(signal.SIGTERM)
            assert await peer.program.end() == 0, [
                line for line in peer.program.lines if not line.startswith(("event", "publish"))
            ][-40:]
    finally:
        busd.close()
    assert busd.faults > 0
    assert sum(line.startswith("event 1: ") for line in peer.program.lines) >= CONNECTIONS - 1
