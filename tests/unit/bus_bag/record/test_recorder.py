"""The end of a recording: on request, at once, and by a failure. There is no bus, and the disk stands
still.
"""

import asyncio
import threading
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

import pytest

from bus.graph import Graph
from bus.logger import get_logger
from bus_bag.errors import BagError
from bus_bag.record import recorder as module
from bus_bag.record.choice import Wanted
from bus_bag.record.options import RecordOptions
from bus_bag.record.recorder import Recorder
from bus_bag.record.state import RecordingState
from semantics import until


class Node:
    """A node on an empty bus."""

    full_name = "/recorder"
    is_connected = True

    def get_logger(self) -> Any:
        return get_logger("recorder")

    async def create_publisher(self, *words: Any) -> None:
        pass

    async def create_service(self, *words: Any) -> None:
        pass

    async def graph(self) -> Graph:
        return Graph(1, 0, (), (), (), ())

    async def watch_graph(self) -> AsyncIterator[Graph]:
        yield await self.graph()
        await asyncio.Event().wait()


class Disk:
    """A disk that stands still until `go_on`. A job of the recorder blocks all later jobs."""

    def __init__(self, recorder: Recorder) -> None:
        self._may_write = threading.Event()
        begun = threading.Event()

        def hold_up() -> None:
            begun.set()
            self._may_write.wait(10)

        thread = recorder.pipeline._thread
        assert thread is not None
        thread.run(hold_up)
        assert begun.wait(30)
        self.go_on = self._may_write.set


async def begin(folder: Path, **options: Any) -> tuple[Recorder, "asyncio.Future[Any]"]:
    node: Any = Node()
    recorder = Recorder(node, RecordOptions(folder=folder, wanted=Wanted(all_topics=True), **options))
    running = asyncio.ensure_future(recorder.run())
    await until(lambda: running.done() or recorder.state is RecordingState.RECORDING)
    return recorder, running


async def test_the_second_request_to_stop_does_not_wait_for_the_disk(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(module, "_PATIENCE_S", 0.01)
    recorder, running = await begin(tmp_path / "walk")
    disk = Disk(recorder)
    recorder.stop()
    done, _ = await asyncio.wait([running], timeout=0.05)
    assert not done and recorder.state is RecordingState.FINISHING
    recorder.stop()
    with pytest.raises(BagError, match="the disk does not answer"):
        await running
    assert recorder.state is RecordingState.CLOSED
    recorder.stop()  # a third request comes too late for an effect
    disk.go_on()


async def test_the_first_request_to_stop_waits_for_the_disk(tmp_path: Path) -> None:
    recorder, running = await begin(tmp_path / "walk")
    disk = Disk(recorder)
    recorder.stop()
    await asyncio.sleep(0.02)
    disk.go_on()
    assert await running == {}
    assert (tmp_path / "walk" / "metadata.yaml").exists()


@pytest.mark.parametrize("max_cache_size", [0, 1 << 20])
async def test_what_can_not_be_written_ends_it_at_once(tmp_path: Path, max_cache_size: int) -> None:
    recorder, running = await begin(tmp_path / "walk", max_cache_size=max_cache_size)

    def fail() -> None:
        raise OSError("no such device")

    recorder.pipeline._run(fail, 0)
    await running
    assert str(recorder.failure) == "no such device"
