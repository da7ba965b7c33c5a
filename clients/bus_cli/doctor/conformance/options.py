"""The options of `bus doctor --conformance`. Imports nothing that plays a story, for a plain `bus doctor`."""

from argparse import ArgumentParser

__all__ = ["NAMES", "PLACE", "RELAY", "add_arguments"]

NAMES = (
    *("hello", "declare", "publish", "subscribe", "ping", "unknown", "split", "refusal"),
    *("fault", "events", "window", "limit", "restart", "serve", "call", "real", "growth"),
)
"""The stories, in the order in which they are played."""

PLACE = "{socket}"
"""In the client's arguments, stands for the path of the socket."""

RELAY = "/conformance/in", "/conformance/out"
"""A client that publishes the messages of the first topic on the second shows that it understood them."""

_WAIT_S = 10.0


def add_arguments(parser: ArgumentParser) -> None:
    group = parser.add_argument_group("clients in other languages")
    group.add_argument(
        "--conformance",
        action="store_true",
        help="start the client that is named after -- once for each story, with a busd that tests it, "
        f"and say what it does wrong. It finds the socket in BUSD_SOCKET, or as {PLACE} in its arguments",
    )
    group.add_argument(
        "--story", action="append", choices=NAMES, help="play only this story; may be repeated"
    )
    group.add_argument(
        "--wait",
        metavar="S",
        type=float,
        default=_WAIT_S,
        help=f"longest time to wait for anything (default: {_WAIT_S:g} s)",
    )
