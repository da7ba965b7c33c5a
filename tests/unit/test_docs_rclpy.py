"""docs/rclpy.md and the facade: the page lists all names that exist and no others, and missing names give an
error.
"""

import inspect
import pkgutil
import re
import subprocess
import sys
from collections.abc import Iterator
from enum import Enum
from importlib import import_module
from itertools import takewhile
from pathlib import Path
from typing import Any

import bus
import bus_ros.rclpy
from bus.node import SERVICE_QOS
from bus_ros import aliases, import_hook
from bus_ros.entity import Entity
from bus_ros.rclpy.impl.async_entity import AsyncEntity
from rows import for_each

DOCS = Path(__file__).parents[2] / "docs"
TEXT = (DOCS / "rclpy.md").read_text()

INSIDE = {
    "rclpy.clock": {"ANY_JUMP", "CHANGES_OF_SOURCE", "OverridableClock"},
    "rclpy.event_handler": {
        *("PUBLISHER_EVENTS", "SUBSCRIPTION_EVENTS", "publisher_events", "subscription_events"),
        "watch_event",
    },
    "rclpy.parameter": {"ValueType", "parameter_message"},
    "rclpy.lifecycle.publisher": {"PublishesWhileActive"},
    "rclpy.publisher": {"why_closed"},
    "rclpy.subscription": {"message_info"},
    "rclpy.impl.rcutils_logger": {"level_of"},
    "rclpy.task": {"UNFINISHED", "Answer", "Step"},
    "rclpy.serialization": {"native_bytes"},
    "rclpy.qos": {"from_native", "profile_of", "to_native"},
    "rclpy.validate_topic_name": {
        *(
            "expand_topic_name",
            "full_name",
            "HIDDEN_TOPIC_PREFIX",
            "topic_or_service_is_hidden",
            "validate_full_topic_name",
        ),
        *("validate_namespace", "validate_node_name", "validate_parameter_name"),
    },
}
"""Public names of a module that rclpy hasn't. The facade's modules use them among themselves."""

INSIDE_OF_CLASSES = {
    "rclpy.experimental.async_action.AsyncActionClient": {"hold", "release"},
    "rclpy.experimental.async_client.AsyncClient": {"events", "forget_events", "hold", "release"},
    "rclpy.experimental.async_clock.AsyncClock": {"destroy", "is_destroyed"},
    "rclpy.experimental.async_node.AsyncNode": {"native"},
    "rclpy.experimental.async_publisher.AsyncPublisher": {"hold", "release"},
    "rclpy.experimental.async_service.AsyncService": {"events", "forget_events", "is_async", "native"},
    "rclpy.experimental.async_timer.AsyncTimer": {"forget_clock", "is_simulated"},
    "rclpy.callback_groups.CallbackGroup": {"is_exclusive", "is_shared"},
    "rclpy.client.Client": {"events", "forget_events", "native", "on_response"},
    "rclpy.clock.ClockEvent": {"recheck"},
    "rclpy.clock.Clock": {"destroy", "is_destroyed"},
    "rclpy.clock.ROSClock": {"destroy", "is_destroyed"},
    "rclpy.clock.JumpHandle": {"post_callback", "pre_callback", "threshold"},
    "rclpy.clock.JumpThreshold": {"is_exceeded"},
    "rclpy.context.Context": {
        *("all", "arguments", "domain_id", "end_by_signal", "nodes", "parameters", "wake_at_end"),
        *("is_valid", "nodes_of_this_thread", "notify_at_end", "was_ended_by_signal"),
    },
    "rclpy.executors.Executor": {
        *(
            "enqueue",
            "asks_always",
            "is_custom",
            "last_handed",
            "lone",
            "handed",
            "is_looking",
            "on_timers_changed",
            "ready",
            "waiter",
            "wake_up",
        ),
    },
    "rclpy.impl.rcutils_logger.RcutilsLogger": {"add_sink", "critical", "remove_sink"},
    "rclpy.node.Node": {"last_executor", "native", "own_entities", "own_executor", "receive_one", "waiting"},
    "rclpy.publisher.Publisher": {"event_callbacks", "is_destroyed", "native", "node"},
    "rclpy.subscription.Subscription": {"batch", "event_callbacks", "native"},
    "rclpy.signals.SignalHandlerGuardCondition": {"is_destroyed"},
    "rclpy.service.Service": {"begin", "events", "forget_events", "native", "on_request"},
    "rclpy.task.Future": {"call_when_done", "forget_waiter"},
    "rclpy.task.Task": {"call_when_done", "forget_waiter", "reschedule"},
    "rclpy.time.Time": {"of_clock"},
    "rclpy.timer.Timer": {
        *("due_ns", "forget_clock", "is_simulated", "rearm", "sleepers", "wake_ns", "wake_sleepers"),
    },
    "rclpy.topic_endpoint_info.TopicEndpointInfo": {"from_graph"},
    "rclpy.type_hash.TypeHash": {"parse"},
}

ROWLESS = {
    *("rclpy.client.BaseClient", "rclpy.clock.BaseClock", "rclpy.node.BaseNode"),
    *("rclpy.publisher.BasePublisher", "rclpy.service.BaseService", "rclpy.subscription.BaseSubscription"),
    *("rclpy.timer.BaseTimer", "rclpy.experimental.async_lifecycle.AsyncLifecycleNode"),
    "rclpy.experimental.async_lifecycle.AsyncLifecyclePublisher",
    *("rclpy.callback_groups.MutuallyExclusiveCallbackGroup", "rclpy.callback_groups.ReentrantCallbackGroup"),
    *("rclpy.executors.EventsExecutor", "rclpy.executors.MultiThreadedExecutor"),
    *("rclpy.executors.SingleThreadedExecutor", "rclpy.InitContextManager"),
    *("rclpy.impl.rcutils_logger.LoggingFilter", "rclpy.impl.rcutils_logger.Once"),
    *("rclpy.impl.rcutils_logger.SkipFirst", "rclpy.impl.rcutils_logger.Throttle"),
    *("rclpy.lifecycle.node.LifecycleNode", "rclpy.lifecycle.node.LifecyclePublisher"),
    *("rclpy.logging_service.LoggingService", "rclpy.parameter_service.ParameterService"),
}
"""Classes with the members of their bases only, or with members that programs do not use."""


def section(title: str) -> str:
    _, found, rest = TEXT.partition(f"\n## {title}\n")
    assert found, f"there is no section {title}"
    return rest.partition("\n## ")[0]


def rows(head: str, text: str = TEXT) -> list[list[str]]:
    """The rows of the table whose head begins with `head`."""
    _, found, rest = text.partition(f"\n| {head} |")
    assert found, f"there is no table {head}"
    lines = takewhile(lambda line: line.startswith("|"), rest.splitlines()[2:])
    return [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]


def names_in(cell: str) -> list[str]:
    return re.findall(r"`([\w.]+)`", cell)


def load(module: str) -> Any:
    return import_module(f"bus_ros.{module}")


def find(path: str) -> Any:
    module, _, name = path.rpartition(".")
    return getattr(load(module), name)


def modules() -> Iterator[str]:
    yield "rclpy"
    for found in pkgutil.walk_packages(bus_ros.rclpy.__path__, "bus_ros.rclpy."):
        if found.name != "bus_ros.rclpy.impl":  # an empty package
            yield found.name.removeprefix("bus_ros.")
    yield from (f"rclpy.{name}" for name in aliases.MODULES)


def public_names(module: str) -> set[str]:
    loaded = load(module)
    return set(getattr(loaded, "__all__", ())) or {one for one in vars(loaded) if not one.startswith("_")}


def members(cls: type) -> set[str]:
    """Public attributes of the class, and the attributes that its methods assign."""
    found: set[str] = set()
    for part in cls.__mro__:
        if part.__module__.startswith(("bus.", "bus_ros.")):
            found.update(vars(part), getattr(part, "__annotations__", ()))
            found.update(re.findall(r"\bself\.(\w+)(?:: [^=\n]+)? = ", inspect.getsource(part)))
    return {name for name in found if not name.startswith("_")}


def _classes() -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for cell, listed in rows("class | members"):
        (name,) = names_in(cell)
        base = re.match(r"those of (\w+)", listed)
        above = found[f"{name.rpartition('.')[0]}.{base[1]}"] if base else []
        found[name] = [*found.get(name, []), *above, *names_in(listed)]
    return found


def inside_of(name: str) -> set[str]:
    """Names that are not for programs, such as those that every entity has for executors."""
    of_entities: set[str] = set()
    for base in (Entity, AsyncEntity):
        if issubclass(find(name), base):
            of_entities |= members(base) - {"callback_group", "destroy"}
    return of_entities | INSIDE_OF_CLASSES.get(name, set())


MODULES = {names_in(cell)[0]: names_in(listed) for cell, listed in rows("module | names")}
CLASSES = _classes()
TOOLS = {names_in(cell)[0]: names_in(listed) for cell, listed in rows("module of the tools | names")}


def test_every_module_is_listed() -> None:
    ours = {f"rclpy.{name}" for name in names_in(section("Inside")) if name != "bus_ros.rclpy"}
    assert {*MODULES, *ours} == set(modules())


@for_each("module", MODULES)
def test_names_of_modules(module: str) -> None:
    assert set(MODULES[module]) == public_names(module) - INSIDE.get(module, set())
    for name in MODULES[module]:
        assert getattr(load(module), name) is not None


@for_each("module", TOOLS)
def test_names_of_tools(module: str) -> None:
    found = import_module(import_hook._ALIASES.get(module, f"bus_ros.{module}"))
    assert set(TOOLS[module]) == set(found.__all__)
    for name in TOOLS[module]:
        assert getattr(found, name) is not None


def test_every_module_of_tools_is_listed() -> None:
    folders = [name for name in import_hook._SAME if name.startswith("ros2")]
    there = {
        found.name.removeprefix("bus_ros.")
        for folder in folders
        for found in pkgutil.walk_packages(load(folder).__path__, f"bus_ros.{folder}.")
    }
    others = {
        "rosidl_adapter.parser",
        *(name for name in import_hook._ALIASES if name.startswith("rosidl_r")),
    }
    same = {"rosidl_runtime_py.import_message", "rosidl_runtime_py.set_message"}
    assert set(TOOLS) == there | others - same


@for_each("name", CLASSES)
def test_members_of_classes(name: str) -> None:
    assert set(CLASSES[name]) == members(find(name)) - inside_of(name)


def test_every_class_is_listed() -> None:
    """Exceptions, enums, and tuples and dicts with names need no row."""
    values = [getattr(load(module), name) for module, names in MODULES.items() for name in names]
    there = {
        one
        for one in values
        if isinstance(one, type)
        and one.__module__.startswith("bus_ros.rclpy")
        and not issubclass(one, (BaseException, Enum, tuple, dict))
    }
    assert there == {find(name) for name in {*CLASSES, *ROWLESS}}


def test_what_the_tables_leave_out_is_there() -> None:
    for module, names in INSIDE.items():
        assert names <= public_names(module), module
    for cls, names in INSIDE_OF_CLASSES.items():
        assert names <= members(find(cls)), cls


def test_attributes_of_the_package() -> None:
    assert bus_ros.rclpy.Node is find("rclpy.node.Node")  # type: ignore[attr-defined]
    assert bus_ros.rclpy.Parameter is find("rclpy.parameter.Parameter")  # type: ignore[attr-defined]
    assert bus_ros.rclpy.Context is find("rclpy.context.Context")  # type: ignore[attr-defined]
    for module in MODULES:
        _, _, name = module.partition(".")
        if name and "." not in name and not name.startswith("_"):
            assert getattr(bus_ros.rclpy, name) is load(module)


def test_what_may_stand_in_a_with() -> None:
    (said,) = re.findall(r"\n\n([^.|]*?) are\s+context\s+managers", TEXT)
    named = re.findall(r"\w+", said.replace(" and ", ", "))
    assert named
    for name, cls in {name.rpartition(".")[2]: find(name) for name in CLASSES}.items():
        assert (name in named) == hasattr(cls, "__enter__"), name


def test_packages_of_messages() -> None:
    share = Path(str(bus.__file__)).parent / "share"
    ((cell,),) = rows("package")
    kinds = ("msg", "srv", "action")
    there = [path.name for path in share.iterdir() if any((path / kind).is_dir() for kind in kinds)]
    assert sorted(names_in(cell)) == sorted(there)


def test_arguments_that_do_nothing_are_taken() -> None:
    for cell, arguments, why in rows("call | argument | reason"):
        (path,) = names_in(cell)
        owner, _, name = path.rpartition(".")
        call = find(path) if owner in MODULES else getattr(find(owner), name)
        assert set(names_in(arguments)) <= set(inspect.signature(call).parameters), path
        assert why


@for_each(("cell", "without"), rows("class | missing"))
def test_attributes_that_are_missing(cell: str, without: str) -> None:
    (path,) = names_in(cell)
    assert names_in(without)
    assert set(names_in(without)) & members(find(path)) == set()


def test_modules_that_are_missing(tmp_path: Path) -> None:
    """For these modules, the error comes from busd and names them."""
    missing = [name for cell, _ in rows("module | purpose") for name in names_in(cell)]
    assert sorted(missing) == sorted(import_hook._MISSING)
    program = tmp_path / "program.py"
    program.write_text(
        "import sys, bus.rclpy_compat\n"
        "for name in sys.argv[1:]:\n"
        "    try:\n"
        "        __import__(name)\n"
        "    except ModuleNotFoundError as error:\n"
        "        print(error)\n"
        "    else:\n"
        "        print('there is a', name)\n"
    )
    command = [sys.executable, str(program), *missing]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    for name, line in zip(missing, done.stdout.splitlines(), strict=True):
        assert line.startswith(f"busd has no '{name}'"), line


def test_values_in_the_text() -> None:
    assert f"`{find('rclpy.utilities.get_rmw_implementation_identifier')()}` |" in TEXT
    assert find("rclpy.executors.EventsExecutor") is find("rclpy.executors.SingleThreadedExecutor")
    assert f"waits for room, at most {find('rclpy.publisher.ROOM_S'):g} s" in TEXT
    assert f"| the default depth of services | 10 | {SERVICE_QOS.depth}," in TEXT


def test_links_lead_somewhere() -> None:
    for target in re.findall(r"\]\(([^)#]+)", TEXT):
        assert (DOCS / target).exists(), target
    titles = {title.lower().replace(" ", "-") for title in re.findall(r"^## (.*)$", TEXT, re.MULTILINE)}
    assert set(re.findall(r"\]\(#([^)]+)\)", TEXT)) <= titles
