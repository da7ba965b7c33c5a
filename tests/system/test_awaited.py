"""A forgotten `await`: the warning names its line, and no call waits forever for an unclosed object."""

import asyncio
import gc
import inspect
import sys
from collections.abc import Callable, Coroutine
from typing import Any

import pytest

import bus
from bus.base.callbacks import is_async
from bus.endpoint.endpoint import core_of
from bus.msg.std_msgs import String
from bus.srv.std_srvs import Empty
from semantics import node, until

__all__ = ["node"]

pytestmark = pytest.mark.usefixtures("daemon")


def warned_at(make: Callable[[], object]) -> tuple[str, int, str]:
    """The warning if the result of `make` is discarded: its text, its line and its file."""
    with pytest.warns(RuntimeWarning) as told:
        make()
        gc.collect()
    (one,) = told
    return str(one.message), one.lineno, one.filename


MADE: dict[str, Callable[[bus.Node], Coroutine[Any, Any, Any]]] = {
    "Node.open": lambda node: bus.Node("other", arguments=()).open(),
    "Node.create_publisher": lambda node: node.create_publisher(String, "t"),
    "Node.create_subscription": lambda node: node.create_subscription(String, "t"),
    "Node.create_service": lambda node: node.create_service(Empty, "s", lambda request: request),
    "Node.create_client": lambda node: node.create_client(Empty, "s"),
}


@pytest.mark.parametrize("name", MADE)
async def test_what_was_not_made_is_told(node: bus.Node, name: str) -> None:
    line = MADE[name].__code__.co_firstlineno
    assert warned_at(lambda: MADE[name](node)) == (f"coroutine '{name}' was never awaited", line, __file__)
    assert node._rosout is not None
    of_the_log: Any = node._rosout._publisher  # None until it is made
    assert node._endpoints._all in ([], [of_the_log and core_of(of_the_log)])


async def test_frameworks_see_coroutine_functions(node: bus.Node) -> None:
    publisher = await node.create_publisher(String, "t")
    for function in (
        node.open,
        node.close,
        node.create_publisher,
        node.create_subscription,
        node.create_service,
        node.create_client,
        bus.Node.create_publisher,
        publisher.close,
    ):
        assert asyncio.iscoroutinefunction(function)
        if sys.version_info >= (3, 12):  # before 3.12, inspect only checks the code object
            assert inspect.iscoroutinefunction(function)
    assert not asyncio.iscoroutinefunction(node.create_timer)


async def test_the_line_is_that_of_the_call(node: bus.Node) -> None:
    """Not the line at which the coroutine is discarded."""
    with pytest.warns(RuntimeWarning) as told:
        publisher: Any = node.create_publisher(
            String,
            "t",
        )
        frame = inspect.currentframe()
        assert frame is not None
        here = frame.f_lineno
        del publisher
    assert told[0].lineno == here - 6


async def test_what_was_not_made_has_no_methods(node: bus.Node) -> None:
    """The AttributeError already explains it; a warning would repeat that."""
    publisher: Any = node.create_publisher(String, "t")
    with pytest.raises(
        AttributeError, match=r"has no 'publish' before it is awaited: write await create_pub"
    ):
        publisher.publish(String())
    assert not hasattr(publisher, "topic_name")
    assert (await publisher).topic_name == "/t"
    publisher = node.create_publisher(String, "t")
    assert not hasattr(publisher, "topic_name")
    del publisher


async def test_close_ends_a_reader_all_the_same(node: bus.Node) -> None:
    subscription = await node.create_subscription(String, "t")
    publisher = await node.create_publisher(String, "t")

    async def read() -> list[str]:
        return [message.data async for message in subscription]

    reading = asyncio.create_task(read())
    publisher.publish(String(data="last"))
    await until(lambda: subscription.statistics().delivered)
    text, *_ = warned_at(lambda: subscription.close())
    assert text == "coroutine 'Subscription.close' was never awaited; it is done a little later"
    async with asyncio.timeout(10):
        assert await reading == ["last"]


async def test_what_is_sent_is_sent_all_the_same(node: bus.Node) -> None:
    subscription = await node.create_subscription(String, "t")
    publisher = await node.create_publisher(String, "t")
    text, _, path = warned_at(lambda: publisher.send(String(data="forgotten")))
    assert text == "coroutine 'Publisher.send' was never awaited; it is done a little later"
    assert path == __file__
    async with asyncio.timeout(10):
        assert (await subscription.receive())[0].data == "forgotten"
    with pytest.warns(RuntimeWarning) as told:
        publisher.send(String(data="next"))  # type: ignore[unused-coroutine]
        frame = inspect.currentframe()
        assert frame is not None
        assert told[0].lineno == frame.f_lineno - 3
    async with asyncio.timeout(10):
        assert (await subscription.receive())[0].data == "next"


async def test_all_that_is_closed_so_is_closed(node: bus.Node) -> None:
    client = await node.create_client(Empty, "s")
    service = await node.create_service(Empty, "s", lambda request: Empty.Response())
    publisher = await node.create_publisher(String, "t")
    other = bus.Node("other", arguments=())
    await other.open()
    for one in (client, service, publisher, other):
        name = f"{type(one).__name__}.close"
        assert warned_at(lambda one=one: one.close())[0].startswith(f"coroutine '{name}'")  # type: ignore[misc]
    async with asyncio.timeout(10):
        await node.wait_for_graph(
            lambda graph: [one.name for one in graph.nodes] == [node.name] and not graph.publishers_of("/t")
        )
    with pytest.raises(bus.ConnectionClosed):
        publisher.publish(String())


async def test_where_it_is_not_forgotten(node: bus.Node, recwarn: pytest.WarningsRecorder) -> None:
    """It works like any other coroutine."""
    made = [
        await asyncio.create_task(node.create_publisher(String, "a")),
        await asyncio.wait_for(node.create_publisher(String, "b"), 10),
        *(await asyncio.gather(node.create_publisher(String, "c"), node.create_publisher(String, "d"))),
    ]
    assert [one.topic_name for one in made] == ["/a", "/b", "/c", "/d"]
    cancelled = asyncio.create_task(node.create_publisher(String, "e"))
    cancelled.cancel()
    await asyncio.wait([cancelled])
    coroutine = made[0].close()
    assert asyncio.iscoroutine(coroutine) and coroutine.cr_frame is not None  # type: ignore[attr-defined]
    await coroutine
    with pytest.raises(RuntimeError, match="reuse"):
        await coroutine
    node.create_publisher(String, "f").close()
    assert is_async(node.close) and is_async(made[1].send)
    await asyncio.gather(made[1].send(String()), asyncio.create_task(made[1].send(String())))
    made[1].send(String()).close()
    gc.collect()
    assert recwarn.list == []
