"""Parameters of nodes, asked for and set by the services that every node has for them."""

import asyncio
from collections.abc import Iterable
from typing import Any

from bus.errors import BusError
from bus.parameters.messages import SERVICES, value_message
from bus.parameters.values import ParameterType
from bus.types.classes import message_class, service_class
from bus_web.foxglove import protocol
from bus_web.foxglove.client import Client
from bus_web.foxglove.protocol import Level, Misunderstood, Parameter
from bus_web.foxglove.values import join, parameter_of, split, value_of
from bus_web.hub import Hub
from bus_web.shared_subscriptions import Heard

__all__ = ["EVENTS", "Parameters"]

EVENTS = "/parameter_events"
_ANSWER_S = 3.0
_AT_ONCE = 8


class Parameters:
    """The parameters of all nodes, for one client."""

    def __init__(self, hub: Hub, client: Client) -> None:
        self._hub = hub
        self._client = client
        self._places = asyncio.Semaphore(_AT_ONCE)
        self._followed: set[str] = set()
        self._follows_all = False

    async def get(self, said: protocol.GetParameters) -> None:
        """Send the client the values, and an error for each node that does not answer."""
        wanted = self._by_node(said.names) if said.names else dict.fromkeys(self._nodes())
        found = await asyncio.gather(*(self._values(node, names) for node, names in wanted.items()))
        values = [one for those in found for one in those]
        too_slow = protocol.status(
            Level.WARNING, "parameter values were dropped, because this client reads too slowly"
        )
        self._client.answer(protocol.parameter_values(values, said.id), too_slow)

    async def set(self, said: protocol.SetParameters) -> None:
        """Set them, and report refusals. Then send the values if the client wants them."""
        named = {one.name: one for one in said.parameters}
        wanted = self._by_node(named)
        await asyncio.gather(
            *(self._set(node, [named[join(node, name)] for name in names]) for node, names in wanted.items())
        )
        if said.id is not None:
            await self.get(protocol.GetParameters([*named] or ["."], said.id))

    def follow(self, names: Iterable[str]) -> None:
        """Send changes of these parameters from now on; without names, of all."""
        names = list(names)
        self._follows_all |= not names
        self._followed.update(names[: 10_000 - len(self._followed)])

    def unfollow(self, names: Iterable[str]) -> None:
        """Stop sending changes of these parameters; without names, of all."""
        names = list(names)
        if not names:
            self._follows_all = False
            self._followed.clear()
        self._followed.difference_update(names)

    @property
    def is_following(self) -> bool:
        """Whether changes are of interest."""
        return self._follows_all or bool(self._followed)

    def on_event(self, heard: Heard) -> None:
        """Handle an event of a node about its changed parameters."""
        try:
            event = heard.message
            changed = [
                parameter_of(join(event.node, one.name), one.value)
                for one in (*event.new_parameters, *event.changed_parameters)
            ]
            changed += [Parameter(join(event.node, one.name)) for one in event.deleted_parameters]
        except Exception:  # bytes of a stranger
            return
        told = [one for one in changed if self._follows_all or one.name in self._followed]
        if told:
            self._client.notify(protocol.parameter_values(told))

    def _nodes(self) -> list[str]:
        graph = self._hub.model.graph
        names = {node.full_name for node in graph.nodes}
        return sorted(name for name in names if graph.servers_of(f"{name}/{SERVICES['ListParameters']}"))

    def _by_node(self, names: Iterable[str]) -> dict[str, list[str]]:
        """The names by node. The client is told of the first name that belongs to no node with parameters."""
        nodes = set(self._nodes())
        found: dict[str, list[str]] = {}
        strange: list[str] = []
        for name in names:
            parts = split(name)
            if parts is None or parts[0] not in nodes:
                strange.append(name)
            else:
                found.setdefault(parts[0], []).append(parts[1])
        if strange and strange != ["."]:
            unknown = [f"no node has the parameter {name!r:.200}" for name in strange]
            self._client.say(Level.WARNING, protocol.first_of(unknown))
        return found

    async def _values(self, node: str, names: list[str] | None) -> list[Parameter]:
        """Values of a node's parameters; `names` None means all."""
        async with self._places:
            try:
                async with asyncio.timeout(_ANSWER_S):
                    if names is None:
                        listed = await self._ask(node, "ListParameters", prefixes=[], depth=0)
                        names = sorted(listed.result.names)
                    values = (await self._ask(node, "GetParameters", names=names)).values
            except (BusError, TimeoutError) as error:
                self._complain(node, error)
                return []
        return [parameter_of(join(node, name), value) for name, value in zip(names, values, strict=False)]

    async def _set(self, node: str, given: list[Parameter]) -> None:
        names = [one.name.removeprefix(f"{node}.") for one in given]
        make = message_class("rcl_interfaces/msg/Parameter")
        async with self._places:
            try:
                async with asyncio.timeout(_ANSWER_S):
                    types = (await self._ask(node, "GetParameterTypes", names=names)).types
                    present = dict(zip(names, map(_type_of, types), strict=False))
                    wanted = []
                    for name, one in zip(names, given, strict=True):
                        kind, value = value_of(one, present.get(name, ParameterType.NOT_SET))
                        wanted.append(make(name=name, value=value_message(_message, kind, value)))
                    results = (await self._ask(node, "SetParameters", parameters=wanted)).results
            except Misunderstood as error:
                self._client.say(Level.ERROR, str(error))
                return
            except (BusError, TimeoutError) as error:
                self._complain(node, error)
                return
        refused = [
            f"{one.name} was not set: {result.reason}"
            for one, result in zip(given, results, strict=False)
            if not result.successful
        ]
        if refused:
            self._client.say(Level.ERROR, protocol.first_of(refused))

    async def _ask(self, node: str, service: str, **fields: Any) -> Any:
        definition: Any = service_class(f"rcl_interfaces/srv/{service}")
        client = await self._hub.node.create_client(definition, f"{node}/{SERVICES[service]}")
        try:
            await client.wait_for_service()
            return await client.call(definition.Request(**fields))
        finally:
            await client.close()

    def _complain(self, node: str, error: Exception) -> None:
        reason = str(error) or f"no answer within {_ANSWER_S:g} s"
        self._client.say(Level.WARNING, f"parameters of {node}: {reason}", f"parameters {node}")


def _message(name: str) -> Any:
    return message_class(f"rcl_interfaces/msg/{name}")


def _type_of(number: int) -> ParameterType:
    try:
        return ParameterType(number)
    except ValueError:
        return ParameterType.NOT_SET
