"""`bus component standalone`: run a component in a separate container, until Ctrl-C."""

import asyncio
import signal
import sys
from argparse import ArgumentParser, Namespace
from contextlib import suppress
from uuid import uuid4

from bus_cli.component.remote import add_component_arguments, load
from bus_cli.launch.bus import export
from bus_cli.output import CommandError, complain
from bus_cli.stream import open_node, run_stream

_START_S = 30.0
_PATIENCE_S = 0.5
_CONTAINER = ("rclpy_components", "component_container")


def add_arguments(parser: ArgumentParser) -> None:
    add_component_arguments(parser)
    parser.add_argument(
        "-c",
        "--container-node-name",
        default=f"standalone_container_{uuid4().hex[:12]}",
        help="Name of the standalone container node to be run",
    )


def main(args: Namespace) -> int:
    export(args)
    return run_stream(_run(args))


async def _run(args: Namespace) -> int:
    """Returns the exit code of the container, or minus the number of the signal that ended it."""
    name = args.container_node_name
    container = await asyncio.create_subprocess_exec(
        *(sys.executable, "-m", "bus_cli", "run", *_CONTAINER, "--ros-args", "-r", f"__node:={name}")
    )
    ending = asyncio.create_task(container.wait())
    loading = asyncio.create_task(_load(args, f"/{name}"))
    try:
        await asyncio.wait((ending, loading), return_when=asyncio.FIRST_COMPLETED)
        if not ending.done():
            try:
                await loading
            except CommandError as error:
                complain(f"{error}, interrupting container node")
                container.send_signal(signal.SIGINT)
                await ending
                return 1
        return await ending
    finally:
        loading.cancel()
        await _end(container)


async def _end(container: asyncio.subprocess.Process) -> None:
    """End the container. A Ctrl-C of the terminal has reached it too, so it first gets time to end."""
    with suppress(TimeoutError):
        await asyncio.wait_for(container.wait(), _PATIENCE_S)
    if container.returncode is None:
        with suppress(ProcessLookupError):
            container.terminate()
        await container.wait()


async def _load(args: Namespace, container: str) -> None:
    async with open_node(args) as node:
        await load(node, container, args, appear_s=_START_S)
