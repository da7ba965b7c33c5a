"""launch_ros.loading: the order and the end of loading, with a container of the test."""

import asyncio
from collections.abc import Iterator
from typing import Any

import pytest

from bus.errors import ServiceError
from bus.types.classes import service_class
from bus_launch.launch import logging
from bus_launch.launch_ros.load_requests import LoadRequest
from bus_launch.launch_ros.loading import load

LOAD_NODE: Any = service_class("composition_interfaces/srv/LoadNode")


class Container:
    """Stands for a node, and for its client of a container, which answers by the names of components."""

    def __init__(self) -> None:
        self.asked: list[str] = []
        self.is_asked_slowly = asyncio.Event()

    def __call__(self, *_: object, **__: object) -> "Container":
        return self

    async def __aenter__(self) -> "Container":
        return self

    async def __aexit__(self, *_: object) -> None:
        pass

    async def create_client(self, definition: object, name: str) -> "Container":
        return self

    async def wait_for_service(self) -> None:
        pass

    async def call(self, request: Any) -> Any:
        self.asked.append(request.node_name)
        if request.node_name == "broken":
            raise ServiceError("load_node", "it fell over")
        if request.node_name == "slow":
            self.is_asked_slowly.set()
            await asyncio.get_running_loop().create_future()
        is_good = request.node_name != "refused"
        name = f"/{request.node_name}"
        return LOAD_NODE.Response(success=is_good, full_node_name=name, error_message="no such plugin")


@pytest.fixture
def logs(tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path_factory.mktemp("log")))
    logging.reset()
    yield
    logging.reset()


@pytest.fixture
async def container(logs: None, monkeypatch: pytest.MonkeyPatch) -> Container:
    made = Container()
    monkeypatch.setattr("bus.node.Node", made)
    return made


def request(name: str) -> LoadRequest:
    return LoadRequest("pkg", "pkg::Part", name, "/", [], {}, {})


async def test_one_after_the_other_also_after_errors(
    container: Container, capsys: pytest.CaptureFixture[str]
) -> None:
    names = ["first", "broken", "refused", "last"]
    await load("/box", [request(name) for name in names], None)
    assert container.asked == names
    failed = "Failed to load node '{}' of type 'pkg::Part' in container '/box': {}"
    said = [line.partition("]: ")[2] for line in capsys.readouterr().out.splitlines()]
    assert said[0] == "Loaded node '/first' in container '/box'"
    assert said[1].startswith("Failed to load node 'broken' of type 'pkg::Part'") and "fell over" in said[1]
    assert said[2] == failed.format("refused", "no such plugin")
    assert said[3] == "Loaded node '/last' in container '/box'"


async def test_what_is_not_loaded_when_the_container_ends(
    container: Container, capsys: pytest.CaptureFixture[str]
) -> None:
    ended = asyncio.get_running_loop().create_future()
    task = asyncio.ensure_future(load("/box", [request(one) for one in ("first", "slow", "last")], ended))
    await container.is_asked_slowly.wait()
    ended.set_result(None)
    await task
    assert container.asked == ["first", "slow"]
    said = capsys.readouterr().out
    assert "'first' of type" not in said
    for name in ("slow", "last"):
        line = (
            f"Failed to load node '{name}' of type 'pkg::Part' in container '/box': the container has ended"
        )
        assert line in said
