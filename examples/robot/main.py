"""The lesson's physical-AI graph: perception, cognition, actuation and monitoring, each a separate process.

Starts busd on a separate socket and the layers, and restarts none of them. Ctrl-C ends all. With SECONDS it
ends by itself; the status is 0 only if every topic reached at least 80 % of its rate and no layer ended.

With --c: a camera in C, a controller in C++, and monitoring. Builds both in the folder $BUILD first.
"""

import argparse
import asyncio
import os
import shutil
import subprocess
import sys
from contextlib import suppress
from pathlib import Path
from tempfile import TemporaryFile
from typing import Any, NamedTuple, NoReturn

import bus
from common import CAMERA, COMMAND, HEALTH_TOPIC, TOPICS, Health, Topic

sys.path.insert(0, str(Path(__file__).parents[1]))

from processes import START_S, Failure, Launch, run

HERE = Path(__file__).parent
IN_C = HERE / "c"
LEAST_SHARE = 0.8
SLACK_S = 5.0
"""Time that the last report may be late."""


class Robot(NamedTuple):
    """The programs of a robot by name, and its topics."""

    programs: dict[str, tuple[str | Path, ...]]
    topics: tuple[Topic[Any], ...]


def robot_in_python() -> Robot:
    layers = ("perception", "cognition", "actuation", "monitoring")
    programs: dict[str, tuple[str | Path, ...]] = {
        name: (sys.executable, HERE / f"{name}.py") for name in layers
    }
    return Robot(programs, TOPICS)


def robot_in_c() -> Robot:
    """Builds its programs. Raises Failure if that is not possible."""
    tools = ("make", os.environ.get("CC", "cc"), os.environ.get("CXX", "c++"))
    if missing := [name for name in tools if shutil.which(name.split()[0]) is None]:
        raise Failure(
            f"a camera in C and a controller in C++ need a compiler: there is no {', no '.join(missing)}"
        )
    build = Path(os.environ.get("BUILD", IN_C / "build")).absolute()
    given = (f"BUILD={build}", f"BUS={sys.executable} -m bus_cli", f"CC={tools[1]}", f"CXX={tools[2]}")
    print("building the camera (C) and the controller (C++)", flush=True)
    if subprocess.run(["make", "-s", "-C", IN_C, *given], check=False).returncode:
        raise Failure("the camera and the controller could not be built")
    topics = (CAMERA, COMMAND)
    programs: dict[str, tuple[str | Path, ...]] = {name: (build / name,) for name in ("camera", "controller")}
    programs["monitoring"] = (sys.executable, HERE / "monitoring.py", *(topic.name for topic in topics))
    return Robot(programs, topics)


async def run_robot(robot: Robot, seconds: float | None, stderr: int | None) -> int:
    """Run the robot; returns the exit status."""
    deaths: list[str] = []
    try:
        async with Launch() as launch, bus.Node("robot") as node:
            for name, command in robot.programs.items():
                await launch.start_program(name, *command, stderr=stderr)
            if seconds is None:
                await note_deaths(launch, deaths, node.get_logger())
            reports = await node.create_subscription(Health, HEALTH_TOPIC, 10)
            await launch.during(everything_flows(reports), "a message on every topic", limit_s=START_S)
            watcher = asyncio.create_task(note_deaths(launch, deaths, node.get_logger()))
            health = await collect(reports, seconds)
            watcher.cancel()
    except (Failure, bus.BusError) as error:
        print(f"The robot failed: {error}.", file=sys.stderr)
        return 1
    verdicts = [summarise(health, number, robot.topics) for number in range(len(robot.topics))]
    print("\ntopic              due   sent    got", *(line for line, _ in verdicts), sep="\n")
    problems = deaths + [problem for _, problem in verdicts if problem]
    text = "; ".join(problems)
    print(f"The robot failed: {text}." if text else "Every layer lived, every topic flowed.")
    return 1 if problems else 0


async def everything_flows(reports: bus.Subscription[Health]) -> None:
    async for health in reports:
        if all(topic.received for topic in health.topics):
            return


async def note_deaths(launch: Launch, deaths: list[str], logger: bus.Logger) -> NoReturn:
    """Log each program that ends; never returns."""
    while True:
        deaths.append(await launch.ended.get())
        logger.warning(f"{deaths[-1]}; the others go on")


async def collect(reports: bus.Subscription[Health], seconds: float) -> list[Health]:
    """Monitoring's reports of the next `seconds`; fewer if it stops."""
    health: list[Health] = []
    with suppress(TimeoutError):
        async with asyncio.timeout(seconds + SLACK_S):
            while sum(one.topics[0].window_s for one in health) < seconds:
                health.append((await reports.receive())[0])
    return health


def summarise(
    health: list[Health], number: int, topics: tuple[Topic[Any], ...] = TOPICS
) -> tuple[str, str | None]:
    """A line about a topic, and its fault or None."""
    topic, windows = topics[number], [one.topics[number] for one in health]
    duration_s = sum(window.window_s for window in windows) or 1.0
    sent = sum(window.published for window in windows) / duration_s
    got = sum(window.received for window in windows) / duration_s
    line = f"{topic.name:17} {topic.rate_hz:4.0f} {sent:6.1f} {got:6.1f}"
    least = LEAST_SHARE * topic.rate_hz
    if got >= least:
        return line, None
    if sent >= least:
        return line, f"{topic.name} lost messages: {sent:.1f} Hz sent, {got:.1f} Hz arrived"
    return line, f"{topic.name} had {sent:.1f} of {topic.rate_hz:g} Hz: too slow a machine, or too busy"


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seconds", nargs="?", type=float, metavar="SECONDS")
    parser.add_argument("--c", action="store_true", help="a camera in C and a controller in C++")
    args = parser.parse_args()
    seconds = args.seconds
    if_interrupted = 0 if seconds is None else 130
    try:
        robot = robot_in_c() if args.c else robot_in_python()
    except Failure as error:
        print(f"The robot failed: {error}.", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        return 130
    if not sys.stdout.isatty():
        return run(run_robot(robot, seconds, None), if_interrupted=if_interrupted)
    # The layers' lines would disturb monitoring's table, which shows their log.
    with TemporaryFile() as log:
        status = run(run_robot(robot, seconds, log.fileno()), if_interrupted=if_interrupted)
        log.seek(0)
        if status:
            sys.stderr.write(log.read().decode(errors="replace"))
    return status


if __name__ == "__main__":
    sys.exit(main())
