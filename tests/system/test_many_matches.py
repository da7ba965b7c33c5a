"""Many matches in one process: the cost of each is the same, whatever their number."""

from typing import Any, TypeAlias

import pytest

import bus
from bus.link.incoming import Incoming
from bus.msg.std_msgs import Int32
from bus.wire import messages as m
from bus.wire.session import Carried
from conftest import Daemon
from semantics import until
from stepcount import StepCounter, counts_bytecodes

MANY, FEW = 240, 40

Costs: TypeAlias = dict[tuple[type, str], list[int]]


@pytest.fixture
def costs(monkeypatch: pytest.MonkeyPatch) -> Costs:
    """The bytecodes that this process ran for each message from busd, by kind of message and of endpoint."""
    costs: Costs = {}
    handle = Incoming._handle

    def counted(incoming: Incoming, message: Any) -> None:
        with StepCounter() as steps:
            handle(incoming, message)
        message = message.message if isinstance(message, Carried) else message
        endpoint = incoming._declarations.concerned(message)
        if endpoint is not None:
            costs.setdefault((type(message), endpoint.kind), []).append(steps.bytecodes)

    monkeypatch.setattr(Incoming, "_handle", counted)
    return costs


@counts_bytecodes
@pytest.mark.parametrize("many", ["subscriptions", "publishers"])
async def test_the_last_is_as_cheap_as_the_first(daemon: Daemon, costs: Costs, many: str, route: str) -> None:
    async with bus.Node("hub", rosout=False, arguments=[]) as node:
        publishers = [
            await node.create_publisher(Int32, "t") for _ in range(1 if many == "subscriptions" else MANY)
        ]
        subscriptions = [
            await node.create_subscription(Int32, "t") for _ in range(MANY if many == "subscriptions" else 1)
        ]
        hub = subscriptions[0] if many == "publishers" else publishers[0]
        await until(lambda: hub._core.count_ready() == MANY)
        for endpoint in (publishers if many == "publishers" else subscriptions)[:-1]:
            await endpoint.close()
        await until(lambda: len(hub.matches) == 1)
    kinds = [m.Matched, m.Unmatched]
    if route == "shm" and many == "subscriptions":
        kinds.append(m.Attached)
    for kind in kinds:
        bytecodes = costs[kind, hub._core.kind]
        assert len(bytecodes) >= MANY - 1, kind
        first, last = sum(bytecodes[:FEW]), sum(bytecodes[-FEW:])
        assert last <= 1.25 * first, (
            f"{kind.__name__}: {first} bytecodes for the first {FEW}, {last} for the last"
        )
