"""Loads components into a container: calls its service over the bus, by the name and type of ROS 2."""

import asyncio
import os
from collections.abc import Sequence
from typing import Any

from bus.errors import BusError
from bus_launch.launch import logging
from bus_launch.launch_ros.load_requests import LoadRequest

__all__ = ["load"]

_LOGGER = "launch_ros.actions.load_composable_nodes"
_PATIENCE_S = 5.0
"""Time after which the log names a container that is missing."""


async def load(container: str, requests: Sequence[LoadRequest], ended: "asyncio.Future[None] | None") -> None:
    """Load the components one after the other; a component that can't be loaded is an error in the log.

    Waits for the container, without a limit. `ended`: done when the container's process ends; then the log
    names the components that are not loaded. Cancellation ends the wait.
    """
    logger = logging.get_logger(_LOGGER)
    left = list(requests)
    loading = asyncio.create_task(_load_all(container, left))
    try:
        await asyncio.wait([loading] if ended is None else [loading, ended], return_when="FIRST_COMPLETED")
        if loading.done():
            await loading
            return
        for request in left:
            logger.error(f"{_failed(request, container)}: the container has ended")
    except asyncio.CancelledError:
        logger.warning(
            f"Abandoning wait for the '{container}/_container/load_node' service, due to shutdown."
        )
        raise
    finally:
        loading.cancel()
        await asyncio.wait([loading])


async def _load_all(container: str, left: list[LoadRequest]) -> None:
    """Removes each request from `left` when it has its answer."""
    from bus.node import Node  # late: few launch files have components
    from bus.types.classes import service_class

    logger = logging.get_logger(_LOGGER)
    definition: Any = service_class("composition_interfaces/srv/LoadNode")
    async with Node(f"launch_ros_{os.getpid()}_{id(left)}", arguments=()) as node:
        client = await node.create_client(definition, f"{container}/_container/load_node")
        while left:
            request = left[0]
            await _wait_for(client, container)
            try:
                answer = await client.call(_message(definition, request))
            except BusError as error:
                logger.error(f"{_failed(request, container)}: {error}")
            else:
                if answer.success:
                    logger.info(f"Loaded node '{answer.full_node_name}' in container '{container}'")
                else:
                    logger.error(f"{_failed(request, container)}: {answer.error_message}")
            left.pop(0)


async def _wait_for(client: Any, container: str) -> None:
    try:
        async with asyncio.timeout(_PATIENCE_S):
            await client.wait_for_service()
    except TimeoutError:
        logging.get_logger(_LOGGER).warning(
            f"Waiting for container '{container}': no node has the service '{container}/_container/load_node'"
        )
        await client.wait_for_service()


def _failed(request: LoadRequest, container: str) -> str:
    name = request.node_name or request.plugin_name
    return f"Failed to load node '{name}' of type '{request.plugin_name}' in container '{container}'"


def _message(definition: Any, request: LoadRequest) -> Any:
    fields = request._asdict()
    for field in ("parameters", "extra_arguments"):
        fields[field] = [_parameter(name, value) for name, value in fields[field].items()]
    return definition.Request(**fields)


def _parameter(name: str, value: Any) -> Any:
    from bus.parameters.messages import value_message
    from bus.parameters.values import ParameterType

    type_ = ParameterType.from_parameter_value(value)
    return _class("Parameter")(name=name, value=value_message(_class, type_, value))


def _class(name: str) -> Any:
    from bus.types.classes import message_class

    return message_class(f"rcl_interfaces/msg/{name}")
