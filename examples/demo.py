"""A talker and two listeners, as in the ROS 2 lesson.

Starts busd on a socket of its own and the three programs as processes of their own, and passes their lines
through. Ctrl-C ends them all. With SECONDS it ends by itself, with status 0 only if both listeners heard
every message.
"""

import argparse
import asyncio
import os
import re
import signal
import sys
from collections import defaultdict
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import bus
from launch import START_S, Failure, Launch, run

EXAMPLES = Path(__file__).parent
TOPIC = "/topic"
TALKER = "minimal_publisher"
LISTENERS = ("listener_1", "listener_2")
SAID = re.compile(r'\[(\w+)\]: (?:Publishing|I heard): "(.*)"')
LAST_MESSAGE_S = 10.0


class Transcript:
    """What the programs say: all through one pipe, so that their lines keep their order."""

    def __init__(self) -> None:
        self.texts: dict[str, list[str]] = defaultdict(list)
        """The messages that each node published or heard."""
        self._source, self.sink = os.pipe()
        os.set_blocking(self._source, False)
        asyncio.get_running_loop().add_reader(self._source, self.read)
        self._news = asyncio.Event()
        self._rest = b""

    def read(self) -> None:
        """Pass on and remember everything that was said until now."""
        try:
            while True:
                *lines, self._rest = (self._rest + os.read(self._source, 65536)).split(b"\n")
                for line in lines:
                    text = line.decode(errors="replace")
                    print(text, flush=True)
                    if said := SAID.search(text):
                        self.texts[said[1]].append(said[2])
        except BlockingIOError:
            self._news.set()
        except BrokenPipeError:  # nobody reads our lines any more: end as on Ctrl-C
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
            signal.raise_signal(signal.SIGTERM)

    async def wait_until(self, condition: Callable[[], bool]) -> None:
        """Wait until what was said makes `condition` true."""
        while not condition():
            self._news.clear()
            await self._news.wait()


async def demonstrate(seconds: float | None) -> int:
    """Returns the exit status."""
    os.environ.pop("RCUTILS_CONSOLE_OUTPUT_FORMAT", None)  # we read the lines
    transcript = Transcript()
    try:
        async with Launch() as launch, bus.Node("demo", rosout=False) as node:
            # The talker comes last, so that it is matched with both listeners before its first message.
            for name in LISTENERS:
                rename = ("--ros-args", "-r", f"__node:={name}")
                await launch.start(name, EXAMPLES / "listener.py", *rename, stderr=transcript.sink)
            await launch.during(both_listeners_subscribe(node), limit_s=START_S)
            await launch.start("talker", EXAMPLES / "talker.py", stderr=transcript.sink)
            await launch.during(both_listeners_are_matched(node), limit_s=START_S)
            await launch.during(asyncio.sleep(seconds) if seconds is not None else asyncio.Event().wait())
            if status := await launch.stop("talker", signal.SIGINT):
                raise Failure(f"the talker exited with {status} at SIGINT")
            transcript.read()  # what it said last
            await everything_is_heard(transcript)
    except (Failure, bus.BusError) as error:
        print(f"The demo failed: {error}.", file=sys.stderr)
        return 1
    problem = judge(transcript.texts)
    print(problem or f"Both listeners heard all {len(transcript.texts[TALKER])} messages.", flush=True)
    return 1 if problem else 0


async def both_listeners_subscribe(node: bus.Node) -> None:
    while len((await node.graph()).subscriptions_of(TOPIC)) < len(LISTENERS):
        await asyncio.sleep(0.02)


async def both_listeners_are_matched(node: bus.Node) -> None:
    while True:
        graph = await node.graph()
        publishers = {endpoint.id for endpoint in graph.publishers_of(TOPIC)}
        if sum(match.publisher in publishers for match in graph.matches) == len(LISTENERS):
            return
        await asyncio.sleep(0.02)


async def everything_is_heard(transcript: Transcript) -> None:
    """Waits until both listeners said the talker's last message, or long enough."""
    texts = transcript.texts
    last = texts[TALKER][-1:]
    with suppress(TimeoutError):
        async with asyncio.timeout(LAST_MESSAGE_S):
            await transcript.wait_until(lambda: all(texts[name][-1:] == last for name in LISTENERS))


def judge(texts: dict[str, list[str]]) -> str | None:
    """What is wrong with what was heard."""
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
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("seconds", nargs="?", type=float, metavar="SECONDS")
    seconds = parser.parse_args().seconds
    return run(demonstrate(seconds), if_interrupted=0 if seconds is None else 130)


if __name__ == "__main__":
    sys.exit(main())
