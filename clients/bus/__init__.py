"""busd's client library: nodes, publishers, subscriptions, services and clients on asyncio.

    import bus
    from bus.msg.std_msgs import String

    async def main():
        async with bus.Node("talker") as node:
            publisher = await node.create_publisher(String, "topic", 10)
            publisher.publish(String(data="hi"))

    bus.run(main())

Names are imported at their first use, so tools that need only a few of them start fast.
"""

import _signal  # type: ignore[import-not-found] # built into Python: nothing is loaded

try:
    _mask = _signal.pthread_sigmask(_signal.SIG_BLOCK, [_signal.SIGINT])  # until it can be deferred
except KeyboardInterrupt:  # a SIGINT came just before; Python raises it here, after SIGINT was blocked
    from bus.base.loading import hide_tracebacks_of_imports

    hide_tracebacks_of_imports()
    _signal.pthread_sigmask(_signal.SIG_UNBLOCK, [_signal.SIGINT])  # Python ends the program by SIGINT
    raise

from bus.base.loading import hide_tracebacks_of_imports, loading

hide_tracebacks_of_imports()
with loading():
    _signal.pthread_sigmask(_signal.SIG_SETMASK, _mask)

    # datetime is imported before msgspec. Otherwise msgspec's C core would load it, ignore a
    # KeyboardInterrupt during that import, and crash in its first Decoder.
    import datetime  # noqa: F401
    import os
    from importlib import import_module
    from sys import _getframe
    from types import ModuleType
    from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from bus import qos as qos
    from bus.base.version import RELEASE as __version__
    from bus.blocking import BlockingNode, BlockingPublisher, BlockingSubscription, connect
    from bus.clock import Rate
    from bus.endpoint.matches import Match
    from bus.errors import (
        AccessDenied,
        BrokerUnavailable,
        BusError,
        CommandLineError,
        ConfigurationError,
        ConnectionClosed,
        ForkError,
        LocalProtocolError,
        MessageTypeError,
        ParameterError,
        PayloadTooLarge,
        ProtocolError,
        QuotaExceeded,
        RemoteProtocolError,
        ServiceError,
        ServiceUnavailable,
        SharedMemoryError,
        StartError,
    )
    from bus.events import (
        DeadlineMissed,
        IncompatibleQoS,
        IncompatibleType,
        LivelinessChanged,
        LivelinessLost,
        MatchedChange,
        MessageLost,
        PublisherEvents,
        SubscriptionEvents,
    )
    from bus.graph import EndpointStatistics, Graph, GraphEndpoint, GraphMatch, GraphNode, Origin
    from bus.loan import Loan
    from bus.logger import Logger, Severity, get_logger
    from bus.node import Node
    from bus.node.endpoints import NodeStatistics
    from bus.publisher import Publisher, PublisherStatistics
    from bus.qos import Durability, History, Liveliness, QoS, QoSProfile, Reliability
    from bus.runner import run
    from bus.schema import MessageSchema
    from bus.service.client import ServiceClient, ServiceClientStatistics
    from bus.service.server import RequestId, ServiceServer, ServiceServerStatistics
    from bus.srv import Service
    from bus.subscription import MessageInfo, Subscription, SubscriptionStatistics
    from bus.timer import Timer

_HOMES = {
    "bus.blocking": ("BlockingNode", "BlockingPublisher", "BlockingSubscription", "connect"),
    "bus.service.client": ("ServiceClient", "ServiceClientStatistics"),
    "bus.clock": ("Rate",),
    "bus.endpoint.matches": ("Match",),
    "bus.errors": (
        "AccessDenied",
        "BrokerUnavailable",
        "BusError",
        "CommandLineError",
        "ConfigurationError",
        "ConnectionClosed",
        "ForkError",
        "LocalProtocolError",
        "MessageTypeError",
        "ParameterError",
        "PayloadTooLarge",
        "ProtocolError",
        "QuotaExceeded",
        "RemoteProtocolError",
        "ServiceError",
        "ServiceUnavailable",
        "SharedMemoryError",
        "StartError",
    ),
    "bus.events": (
        "DeadlineMissed",
        "IncompatibleQoS",
        "IncompatibleType",
        "LivelinessChanged",
        "LivelinessLost",
        "MatchedChange",
        "MessageLost",
        "PublisherEvents",
        "SubscriptionEvents",
    ),
    "bus.graph": ("EndpointStatistics", "Graph", "GraphEndpoint", "GraphMatch", "GraphNode", "Origin"),
    "bus.loan": ("Loan",),
    "bus.logger": ("Logger", "Severity", "get_logger"),
    "bus.node": ("Node",),
    "bus.node.endpoints": ("NodeStatistics",),
    "bus.publisher": ("Publisher", "PublisherStatistics"),
    "bus.qos": ("Durability", "History", "Liveliness", "QoS", "QoSProfile", "Reliability"),
    "bus.runner": ("run",),
    "bus.schema": ("MessageSchema",),
    "bus.service.server": ("RequestId", "ServiceServer", "ServiceServerStatistics"),
    "bus.srv": ("Service",),
    "bus.subscription": ("MessageInfo", "Subscription", "SubscriptionStatistics"),
    "bus.timer": ("Timer",),
}
_HOME_OF = {name: module for module, names in _HOMES.items() for name in names}

__all__ = [
    "AccessDenied",
    "BlockingNode",
    "BlockingPublisher",
    "BlockingSubscription",
    "BrokerUnavailable",
    "BusError",
    "CommandLineError",
    "ConfigurationError",
    "ConnectionClosed",
    "DeadlineMissed",
    "Durability",
    "EndpointStatistics",
    "ForkError",
    "Graph",
    "GraphEndpoint",
    "GraphMatch",
    "GraphNode",
    "History",
    "IncompatibleQoS",
    "IncompatibleType",
    "Liveliness",
    "LivelinessChanged",
    "LivelinessLost",
    "Loan",
    "LocalProtocolError",
    "Logger",
    "Match",
    "MatchedChange",
    "MessageInfo",
    "MessageLost",
    "MessageSchema",
    "MessageTypeError",
    "Node",
    "NodeStatistics",
    "Origin",
    "ParameterError",
    "PayloadTooLarge",
    "ProtocolError",
    "Publisher",
    "PublisherEvents",
    "PublisherStatistics",
    "QoS",
    "QoSProfile",
    "QuotaExceeded",
    "Rate",
    "Reliability",
    "RemoteProtocolError",
    "RequestId",
    "Service",
    "ServiceClient",
    "ServiceClientStatistics",
    "ServiceError",
    "ServiceServer",
    "ServiceServerStatistics",
    "ServiceUnavailable",
    "Severity",
    "SharedMemoryError",
    "StartError",
    "Subscription",
    "SubscriptionEvents",
    "SubscriptionStatistics",
    "Timer",
    "__version__",
    "connect",
    "get_logger",
    "qos",
    "run",
]

if os.sysconf("SC_OPEN_MAX") < 100:
    import_module("bus.process.start_errors")  # later there may be no descriptor left to read the file


def __getattr__(name: str) -> Any:
    if name in ("msg", "qos", "srv"):
        return import_module(f"bus.{name}")
    if name == "__version__":
        return import_module("bus.base.version").RELEASE
    if name in _HOME_OF:
        value = globals()[name] = getattr(_import(_HOME_OF[name]), name)
        return value
    # Names that tools search, and modules that `from ... import` is about to import, are no mistakes.
    if name.startswith("_") or _getframe(1).f_code.co_name == "_handle_fromlist":
        raise AttributeError(f"module 'bus' has no attribute {name!r}")
    from bus.base.missing_names import missing_name

    raise missing_name("bus", name, __all__, is_bus=True)


def __dir__() -> list[str]:
    return __all__


def _import(module: str) -> ModuleType:
    """Import a module of the library. A Ctrl-C raises KeyboardInterrupt afterwards."""
    with loading():
        import_module("bus.process.start_errors").check_descriptors()
        return import_module(module)
