"""tf2's texts about frames: reasons why there is no transform, and lists of all frames. Pure."""

import re
from collections.abc import Iterable

from bus_tf2.core.twin import (
    FUTURE,
    LOOP,
    NO_DATA,
    ONE_VALUE,
    PAST,
    UNCONNECTED,
    Failure,
)

__all__ = [
    "all_frames",
    "all_frames_as_dot",
    "all_frames_as_yaml",
    "failure_text",
    "frame_name_fault",
    "quoted",
    "seconds",
]

Row = tuple[str, str | None, str | None, int, int, int]
"""A row of FrameTree.rows."""

_SHORTEST_NS = 100_000
_PLAIN = re.compile(r"(?!(?:null|true|false|yes|no|on|off)$)[^\W\d][\w./-]*", re.IGNORECASE)
"""Names that are texts in YAML without quotes, as tf2 writes all names."""


def seconds(time_ns: int) -> str:
    return f"{time_ns / 1e9:.6f}"


def frame_name_fault(name: str) -> str:
    """The fault of a frame's name in a look-up; "" if it has none."""
    if not name:
        return "in tf2 frame_ids cannot be empty"
    return "in tf2 frame_ids cannot start with a '/'" if name.startswith("/") else ""


def failure_text(failure: Failure, target: str, source: str, rows: Iterable[Row]) -> str:
    kind, asked_ns, have_ns = failure
    if kind == LOOP:
        return f"The tf tree is invalid because it contains a loop.\n{all_frames(rows)}\n"
    if kind == UNCONNECTED:
        return (
            f"Could not find a connection between '{target}' and '{source}' because they are not part of the "
            "same tree.Tf has two or more unconnected trees."
        )
    asked, have = seconds(asked_ns), seconds(have_ns)
    text = {
        NO_DATA: "",
        ONE_VALUE: f"Lookup would require extrapolation at time {asked}, "
        f"but only time {have} is in the buffer",
        FUTURE: "Lookup would require extrapolation into the future.  Requested time "
        f"{asked} but the latest data is at time {have}",
        PAST: "Lookup would require extrapolation into the past.  Requested time "
        f"{asked} but the earliest data is at time {have}",
    }[kind]
    return f"{text}, when looking up transform from frame [{source}] to frame [{target}]"


def all_frames(rows: Iterable[Row]) -> str:
    return "".join(f"Frame {name} exists with parent {parent or 'NO_PARENT'}.\n" for name, parent, *_ in rows)


def all_frames_as_yaml(rows: Iterable[Row], *, is_empty: bool) -> str:
    """All frames as YAML; `is_empty`: no frame is known."""
    lines = ["[]"] if is_empty else []
    for name, parent, authority, count, latest_ns, oldest_ns in rows:
        if parent is not None:
            lines += [
                f"{name if _PLAIN.fullmatch(name) else quoted(name)}: \n",
                f"  parent: {_value(parent)}\n",
                f"  broadcaster: {_value(authority or 'no recorded authority')}\n",
                f"  rate: {_rate(count, latest_ns - oldest_ns):.3f}\n",
                f"  most_recent_transform: {seconds(latest_ns)}\n",
                f"  oldest_transform: {seconds(oldest_ns)}\n",
                f"  buffer_length: {(latest_ns - oldest_ns) / 1e9:.3f}\n",
            ]
    return "".join(lines)


def all_frames_as_dot(rows: Iterable[Row], names: Iterable[str], now_ns: int) -> str:
    """A graph for Graphviz; `now_ns`: 0 leaves out values that depend on it."""
    lines = ["digraph G {\n"]
    parents: dict[str, str | None] = {}
    for name, parent, authority, count, latest_ns, oldest_ns in rows:
        parents[name] = parent
        if parent is not None:
            age = f"( {(now_ns - latest_ns) / 1e9:.3f} sec old)" if now_ns else ""
            lines.append(
                f"{quoted(parent)} -> {quoted(name)}"
                f'[label="Broadcaster: {quoted(authority or "no recorded authority")[1:-1]}\\n'
                f"Average rate: {_rate(count, latest_ns - oldest_ns):.3f} Hz\\n"
                f"Most recent transform: {seconds(latest_ns)} {age}\\n"
                f'Buffer length: {(latest_ns - oldest_ns) / 1e9:.3f} sec\\n"];\n'
            )
    all_names = list(names)
    if not all_names:
        lines.append('"no tf data recieved"')
    legend = (
        "edge [style=invis];\n"
        ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";\n'
    )
    recorded = f'"Recorded at time: {seconds(now_ns)}"[ shape=plaintext ] ;\n ' if now_ns else ""
    for name in all_names:
        is_root = name not in parents
        if (is_root and now_ns) or (not is_root and parents[name] is None):
            lines.append(f"{legend}{recorded}}}->{quoted(name)};\n")
    return "".join([*lines, "}"])


def quoted(text: str) -> str:
    """`text` in double quotes, as in YAML and in Graphviz's language, with escapes for control characters."""
    shown = text.replace("\\", r"\\").replace('"', r"\"")
    if not shown.isprintable():
        shown = "".join(one if one.isprintable() else f"\\U{ord(one):08x}" for one in shown)
    return f'"{shown}"'


def _value(text: str) -> str:
    """`text` as YAML, as tf2 writes it if it can be read again."""
    return f"'{text}'" if text.isprintable() and "'" not in text else quoted(text)


def _rate(count: int, length_ns: int) -> float:
    return count * 1e9 / max(length_ns, _SHORTEST_NS)
