"""A talker and two listeners, as in the ROS 2 lesson.

Starts busd on a separate socket, and each of the three programs as a process. It forwards their output.
Ctrl-C ends all of them. With SECONDS it ends by itself; the status is 0 only if both listeners received every
message.
"""

import argparse
import asyncio
import os
import signal
import sys
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import bus
from processes import START_S, Failure, Launch, run
from transcript import Transcript

EXAMPLES = Path(__file__).parent
TOPIC = "/topic"
TALKER = "minimal_publisher"
LISTENERS = ("listener_1", "listener_2")
LAST_MESSAGE_S = 10.0


async def demonstrate(seconds: float | None) -> int:
    """Run the demonstration; returns the exit status."""
    os.environ.pop("RCUTILS_CONSOLE_OUTPUT_FORMAT", None)  # this program reads the lines
    transcript = Transcript()
    try:
        async with Launch() as launch, bus.Node("demo", rosout=False) as node:
            # The talker starts last, so it is matched with both listeners before its first message.
            for name in LISTENERS:
                rename = ("--ros-args", "-r", f"__node:={name}")
                await launch.start(name, EXAMPLES / "listener.py", *rename, stderr=transcript.sink)
            await launch.during(until(node, listeners_subscribe), "both subscriptions", limit_s=START_S)
            await launch.start("talker", EXAMPLES / "talker.py", stderr=transcript.sink)
            await launch.during(until(node, listeners_match), "the matches", limit_s=START_S)
            await launch.during(asyncio.sleep(seconds) if seconds is not None else asyncio.Event().wait())
            status = await launch.stop("talker", signal.SIGINT)
            if status != -signal.SIGINT:
                raise Failure(f"the talker exited with {status} at SIGINT")
            transcript.read()  # the remaining output
            await everything_is_heard(transcript)
    except (Failure, bus.BusError) as error:
        print(f"The demo failed: {error}.", file=sys.stderr)
        return 1
    problem = judge(transcript.texts)
    print(problem or praise(len(transcript.texts[TALKER])), flush=True)
    return 1 if problem else 0


async def until(node: bus.Node, is_met: Callable[[bus.Graph], bool]) -> None:
    while True:
        if is_met(await node.graph()):
            return
        await asyncio.sleep(0.02)


def listeners_subscribe(graph: bus.Graph) -> bool:
    return len(graph.subscriptions_of(TOPIC)) == len(LISTENERS)


def listeners_match(graph: bus.Graph) -> bool:
    publishers = {endpoint.id for endpoint in graph.publishers_of(TOPIC)}
    return sum(match.publisher in publishers for match in graph.matches) == len(LISTENERS)


async def everything_is_heard(transcript: Transcript) -> None:
    """Wait until both listeners have printed the talker's last message, with a time limit."""
    texts = transcript.texts
    last = texts[TALKER][-1:]
    with suppress(TimeoutError):
        async with asyncio.timeout(LAST_MESSAGE_S):
            await transcript.wait_until(lambda: all(texts[name][-1:] == last for name in LISTENERS))


def praise(heard: int) -> str:
    return f"Both listeners heard all {heard} messages." if heard > 1 else "Both listeners heard the message."


def judge(texts: dict[str, list[str]]) -> str | None:
    """The fault in the received messages; None without one."""
    published = texts[TALKER]
    if not published:
        return "The talker published nothing."
    for name in LISTENERS:
        lost = [text for text in published if text not in texts[name]]
        if lost:
            return f'{name} did not hear {len(lost)} of {len(published)} messages; the first is "{lost[0]}".'
        if texts[name] != published:
            return f"{name} heard messages twice or out of order: {texts[name]}."
    return None


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("seconds", nargs="?", type=float, metavar="SECONDS")
    seconds = parser.parse_args().seconds
    return run(demonstrate(seconds), if_interrupted=0 if seconds is None else 130)


if __name__ == "__main__":
    sys.exit(main())
