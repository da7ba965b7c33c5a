"""`bus completion bash|zsh`, and completion of names from the live graph."""

from argparse import Action, ArgumentParser, Namespace
from collections.abc import Callable, Iterable, Iterator
from typing import TYPE_CHECKING, Any

from bus.base.optional import how_to_install
from bus_cli.output import CommandError, say
from bus_cli.program_name import ALIAS, NAME, program_name

if TYPE_CHECKING:
    from bus.graph import Graph

SHELLS = ("bash", "zsh")


def add_arguments(parser: ArgumentParser) -> None:
    parser.description = 'Put this into your ~/.bashrc or ~/.zshrc: eval "$(bus completion bash)"'
    parser.add_argument("shell", choices=SHELLS, help="the shell to print code for")


def main(args: Namespace) -> int:
    try:
        from argcomplete import shellcode  # type: ignore[attr-defined,unused-ignore]
    except ImportError:
        raise CommandError(f"completion needs argcomplete: {how_to_install('argcomplete')}") from None
    # argcomplete's code works in both shells: it checks which shell runs it.
    say(shellcode(_names(), shell=args.shell).rstrip())
    return 0


def _names() -> list[str]:
    """Names of this program: `ros2` is one of them if a user has installed it, or has called it."""
    import shutil
    from pathlib import Path

    from bus_cli.ros2.script import is_ours

    found = shutil.which(ALIAS)
    is_alias = program_name() == ALIAS or (found is not None and is_ours(Path(found)))
    return [NAME, ALIAS] if is_alias else [NAME]


def completed_by(action: Action, completer: Callable[..., Iterable[str]]) -> None:
    """Let the shell complete an argument with the results of `completer`."""
    vars(action)["completer"] = completer


def topics(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Names of topics; hidden ones only if the prefix is hidden, too."""
    from bus.names import is_hidden_topic

    graph = live_graph(parsed_args)
    found = graph.topics() if graph else ()
    return [name for name in found if not is_hidden_topic(name) or is_hidden_topic(prefix)]


def nodes(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Full names of nodes."""
    graph = live_graph(parsed_args)
    return sorted({node.full_name for node in graph.nodes}) if graph else []


def types(prefix: str, parsed_args: Namespace, **_: Any) -> list[str]:
    """Names of types: the topic's types if it is on the bus, else all on the bus and all ready-made ones."""
    graph = live_graph(parsed_args)
    by_topic = graph.topics() if graph else {}
    topic = getattr(parsed_args, "topic_name", None)
    if topic in by_topic:
        return by_topic[topic]
    return sorted({*_ready_made(), *(name for names in by_topic.values() for name in names)})


def packages(prefix: str, **_: Any) -> list[str]:
    """Names of packages, including the packages with programs that come with busd."""
    from bus_ros.packages import built_in, names

    return sorted({*names(), *built_in()})


def live_graph(args: Namespace) -> "Graph | None":
    """The current graph; None if no daemon runs, because completion must not start one."""
    from bus.errors import BusError
    from bus_cli.query import get_graph

    try:
        return get_graph(args, may_start=False)
    except (BusError, OSError):
        return None


def _ready_made() -> Iterator[str]:
    from importlib import import_module

    from bus.msg import PACKAGES

    for package in PACKAGES:
        for name in import_module(f"bus.msg.{package}").__all__:
            yield f"{package}/msg/{name}"
