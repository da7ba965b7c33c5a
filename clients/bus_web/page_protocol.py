"""Protocol between the page and the server: JSON, one object with `op` in each frame. Pure.

from the server             | what
----------------------------|--------------------------------------------------------------------
hello                       | which bus it is
graph                       | nodes, topics, endpoints, pairs: once, and when one of them changes
history                     | of topics with messages, Hz in each of the last seconds: once
rates                       | what has changed since the rates before, each second
detail                      | of endpoints of topics that are looked at, all counters
value                       | a message of a topic that is looked at; with it the extremes of plotted
                            | numbers since the last one
fault                       | why no message of such a topic can be shown
log                         | lines of /rosout
status                      | how many messages the server has dropped because this page was slow
bus                         | whether busd answers
recording                   | of `bus web --bag`: name, length and losses of the bag: once
playback                    | status, position and rate of the player, at most 10 times a second
refused                     | why the player did not do what the page asked for

from the page               | what
----------------------------|--------------------------------------------------------------------
look                        | `topics`: names, each with the paths of arrays to be shown at length;
                            | `plots`: names, each with the paths of plotted numbers
log                         | `on`: whether it shows the log
play                        | `at_s`, `rate`, `paused`, `step`: requests to the player, each optional
"""

from collections.abc import Iterable, Mapping
from math import ceil
from typing import Annotated, Any

import msgspec

from bus.base.time_parts import bounds
from bus.names import is_hidden_node
from bus.qos import in_words
from bus_plot.loss_timeline import LossTimeline
from bus_web.extremes import MOST_PLOTTED, Range
from bus_web.model import Model
from bus_web.rows import Ages, TopicRow

__all__ = [
    "SUBPROTOCOL",
    "Log",
    "Look",
    "Mistake",
    "Play",
    "Said",
    "Sent",
    "between",
    "detail",
    "graph",
    "history",
    "message",
    "read",
]

SUBPROTOCOL = "busd.page.v1"
_MOST_LOOKS = 32
_MOST_OPENED = 100
_BARS = 60
_MOST_BURSTS = 8
_MOST_S = 1e10
_encode = msgspec.json.encode


class Mistake(Exception):
    """The page sent an invalid request; the text names the fault."""


class Look(msgspec.Struct, tag="look", tag_field="op", forbid_unknown_fields=True):
    """The page wants values of these topics, and no longer of any other topic."""

    topics: dict[str, list[str]]
    """Paths of arrays to be shown at length."""
    plots: dict[str, list[str]] = {}
    """Paths of plotted numbers."""

    def opened(self) -> dict[str, frozenset[str]]:
        """The arrays of each wanted topic to be shown at length, including arrays with plotted numbers."""
        return {
            topic: frozenset(
                [
                    *(path.rpartition(".")[0] for path in self.plots.get(topic, ())[:MOST_PLOTTED]),
                    *self.topics.get(topic, ())[:_MOST_OPENED],
                ]
            )
            for topic in self.topics.keys() | self.plots.keys()
        }


class Log(msgspec.Struct, tag="log", tag_field="op", forbid_unknown_fields=True):
    """Whether the page wants the log."""

    on: bool


class Play(msgspec.Struct, tag="play", tag_field="op", forbid_unknown_fields=True):
    """Requests to the player of a recording."""

    at_s: Annotated[float, msgspec.Meta(ge=0, le=_MOST_S)] | None = None
    """Seconds from the start of the recording on."""
    rate: float | None = None
    paused: bool | None = None
    step: bool = False
    """Publish the next message; only while paused."""


Said = Look | Log | Play
_decoder = msgspec.json.Decoder(Said)


def read(frame: str | bytes) -> Said:
    """Decode a frame of the page. Raises Mistake."""
    if isinstance(frame, bytes):
        raise Mistake("a page must send text frames")
    try:
        said: Said = _decoder.decode(frame)
    except (msgspec.DecodeError, RecursionError) as error:
        raise Mistake(f"not understood: {error}") from None
    if isinstance(said, Look) and (number := len(said.topics.keys() | said.plots.keys())) > _MOST_LOOKS:
        raise Mistake(f"{number} topics watched; the limit is {_MOST_LOOKS}")
    return said


def message(op: str, **fields: Any) -> bytes:
    """A frame of the server: the bytes of a text."""
    return _encode({"op": op, **fields})


def between(values: Range) -> dict[str, Any]:
    """Fields of a value for plots: the extremes since the value before."""
    ends = {path: [first, second] for path, first, second in values.ends}
    return {"from_ms": values.from_ns / 1e6, "ends": ends}


def graph(model: Model) -> bytes:
    """The frame with everything that changes only with the structure of the graph."""
    rows = model.topics(hidden=True)
    ends = model.all_endpoints()
    return message(
        "graph",
        nodes=[
            [one.id, one.full_name, one.pid, is_hidden_node(one.name), one.origin.bus if one.origin else ""]
            for one in sorted(model.graph.nodes, key=lambda one: one.full_name)
        ],
        topics=[[row.topic, row.types, row.is_hidden] for row in rows],
        ends=[
            [one.id, one.kind, one.node_id, one.topic, one.type_name, in_words(one.qos), one.depth]
            for one in ends
        ],
        pairs=[
            [pair.publisher, pair.subscription, pair.route, pair.reason]
            for row in rows
            for pair in model.pairs(row.topic)
        ],
    )


def history(rows: Iterable[TopicRow]) -> bytes:
    """The frame with the histories of topics that had recent messages or losses."""
    rows = [*rows]
    return message(
        "history",
        topics={row.topic: _short(row.history) for row in rows if any(row.history)},
        losses={row.topic: _short(row.lost_history) for row in rows if row.lost_history},
    )


def detail(model: Model, topics: Iterable[str], now_s: float) -> bytes:
    """All counters of the endpoints of some topics, and the losses of these topics. `now_s`: the time of the
    monotonic clock."""
    topics = [*topics]
    ends = [one for topic in topics for one in model.endpoints(topic)]
    losses = {topic: _losses(one, now_s) for topic in topics if (one := model.losses(topic))}
    return message(
        "detail",
        ends={
            str(one.id): [
                one.messages,
                one.bytes,
                one.queued,
                one.dropped,
                _short(one.lost_history),
                one.advice,
            ]
            for one in ends
        },
        losses=losses,
        ages={topic: _age_bars(parts) for topic in topics if any(parts := model.age_parts(topic))},
    )


def _age_bars(parts: list[int]) -> list[list[float]]:
    """The begin and end of each part in milliseconds, its number; from the first to the last part used."""
    used = [part for part, number in enumerate(parts) if number]
    return [
        [*(round(at_ns / 1e6, 4) for at_ns in bounds(part)), parts[part]]
        for part in range(used[0], used[-1] + 1)
    ]


def _losses(timeline: LossTimeline, now_s: float) -> dict[str, Any]:
    """The past of a topic's losses. Times are seconds ago, because the page has a different clock."""
    began_s = min((slot.at_s for slot in timeline.slots()), default=now_s)
    width_s = max(1, ceil((now_s - began_s) / (_BARS - 1)))
    end_s = (now_s // width_s + 1) * width_s  # so a bar keeps its height while it moves
    return {
        "width_s": width_s,
        "bars": _short(timeline.bars(end_s - width_s * _BARS, end_s, _BARS)),
        "bursts": [
            [round(now_s - one.at_s, 1), one.span_s, one.lost] for one in timeline.bursts(_MOST_BURSTS)
        ],
        "earlier": timeline.earlier,
    }


class Sent:
    """The rates last sent to one page: the next frame has only the changed ones."""

    def __init__(self) -> None:
        self._topics: Mapping[str, list[Any]] = {}
        self._ends: Mapping[str, list[Any]] = {}

    def rates(self, model: Model) -> bytes:
        """The rates of now."""
        rows = model.topics(hidden=True)
        topics = {
            row.topic: [
                _rounded(row.hz),
                _rounded(row.bytes_per_s),
                row.queued,
                row.depth,
                row.lost,
                row.lost_in_all,
                _rounded(row.lost_per_s),
                row.why,
                _age(row.age),
            ]
            for row in rows
        }
        ends = {
            str(one.id): [_rounded(one.hz), one.queued, one.lost, _rounded(one.lost_per_s), _age(one.age)]
            for one in model.all_endpoints()
        }
        new_topics = {name: row for name, row in topics.items() if self._topics.get(name) != row}
        new_ends = {name: row for name, row in ends.items() if self._ends.get(name) != row}
        self._topics, self._ends = topics, ends
        return message("rates", topics=new_topics, ends=new_ends)


def _age(ages: Ages | None) -> list[float | None] | None:
    """p50 (or the mean) and p99 in milliseconds."""
    if ages is None:
        return None
    return [_rounded(ages.usual * 1000), None if ages.p99 is None else _rounded(ages.p99 * 1000)]


def _rounded(value: float | None) -> float | None:
    """Rounded to three digits: smaller changes are not sent."""
    return None if value is None else float(f"{value:.3g}")


def _short(values: Iterable[float]) -> list[float]:
    return [float(f"{value:.3g}") for value in values]
