"""Status of the bridges on this bus. Each bridge has a service for it."""

import asyncio
import os
from pathlib import Path
from typing import TYPE_CHECKING

from bus.errors import BusError
from bus.node import Node
from bus_bridge.core.status import SERVICE_TYPE, GetStatus

if TYPE_CHECKING:
    from bus.graph import Graph

__all__ = ["Answer", "ask_all", "services_of_bridges"]

_ANSWER_S = 3.0

Answer = GetStatus.Response


def services_of_bridges(graph: "Graph") -> list[str]:
    """Names of the services for the status of bridges, sorted."""
    return sorted(name for name, types in graph.services().items() if SERVICE_TYPE in types)


async def ask_all(path: Path, graph: "Graph") -> dict[str, Answer | str]:
    """Ask all bridges in `graph` for their status.

    Returns the status, or the reason why there is none, by the full name of the bridge's node. `path` is the
    socket of their busd.
    """
    services = services_of_bridges(graph)
    async with Node(f"_bus_cli_{os.getpid()}", arguments=(), socket=path, rosout=False) as node:
        answers = await asyncio.gather(*(_ask(node, service) for service in services))
    return {service.rpartition("/")[0]: answer for service, answer in zip(services, answers, strict=True)}


async def _ask(node: Node, service: str) -> Answer | str:
    try:
        client = await node.create_client(GetStatus, service)
        async with asyncio.timeout(_ANSWER_S):
            await client.wait_for_service()
            answer: Answer = await client.call(GetStatus.Request())
            return answer
    except TimeoutError:
        return f"it does not answer ({_ANSWER_S:g} s)"
    except BusError as error:
        return str(error)
