"""Losses of several topics over one time: as text, and as an SVG picture. Pure."""

from collections.abc import Callable, Iterable, Sequence
from math import ceil, floor
from typing import NamedTuple
from xml.sax.saxutils import escape

from bus_plot.bars import bars_text
from bus_plot.loss_timeline import LossTimeline

__all__ = ["Strip", "strips_svg", "strips_text", "tick_step"]

_MOST_BARS = 120
_MOST_BURSTS = 5
_LEFT, _WIDTH, _BAR_HEIGHT, _ROW, _TOP = 12, 720, 46, 84, 44
_COLOURS = ("#c2410c", "#1d6fb8", "#15803d", "#9333ea", "#b45309", "#be185d", "#0f766e", "#6b7280")
_STYLE = """
svg { font: 13px system-ui, sans-serif; background: #fff; color: #1b2733; }
text { fill: currentColor; } .soft { fill: #4d5b69; font-size: 12px; } .name { font-weight: 600; }
line { stroke: #c9d1d9; }
@media (prefers-color-scheme: dark) {
  svg { background: #12181e; color: #e3e9ef; } .soft { fill: #a9b6c3; } line { stroke: #3a4754; }
}
"""


class Strip(NamedTuple):
    """The losses of one topic, with a sentence about them."""

    name: str
    timeline: LossTimeline
    note: str


def tick_step(span_s: float, most: int = 8) -> int:
    """Whole seconds between at most `most` ticks: 1, 2, 5, 10, 15, 30 s, a minute, ..."""
    steps = (1, 2, 5, 10, 15, 30, 60, 120, 300, 600, 900, 1800, 3600, 7200, 14400, 43200, 86400)
    return next((step for step in steps if span_s / step <= most), ceil(span_s / most / 86400) * 86400)


def _frame(strips: Iterable[Strip], begin_s: float, end_s: float, most: int) -> tuple[int, int, int]:
    """The begin of the first bar, the number of bars and their width in seconds: whole seconds, also for
    losses outside of the given time."""
    slots = [slot for strip in strips for slot in strip.timeline.slots()]
    begin = min([floor(begin_s), *(slot.at_s for slot in slots)])
    end = max([ceil(end_s), *(slot.at_s + slot.width_s for slot in slots), begin + 1])
    width = max(1, ceil((end - begin) / most))
    return begin, ceil((end - begin) / width), width


def strips_text(
    strips: Sequence[Strip], begin_s: float, end_s: float, cells: int, moment: Callable[[int], str]
) -> list[str]:
    """A line of bars for each topic, at most `cells` wide, then the newest bursts in words.

    `moment` says a time of the timelines' clock.
    """
    begin, number, width = _frame(strips, begin_s, end_s, max(10, min(cells, _MOST_BARS)))
    lines = []
    for strip in strips:
        bars = strip.timeline.bars(begin, begin + number * width, number)
        lines += [f"{strip.name}: {strip.note}", bars_text(bars)]
        lines += [
            f"  {moment(one.at_s)} ({one.at_s - begin} s), {one.span_s} s: {_reasons(one.lost)}"
            for one in strip.timeline.bursts(_MOST_BURSTS)
        ]
        if strip.timeline.earlier:
            lines.append(f"  time unknown: {_reasons(strip.timeline.earlier)}")
    end = f"{number * width} s"
    lines.append(f"0 s{end.rjust(max(number - 3, len(end) + 1))}, a bar for {width} s")
    return lines


def strips_svg(
    strips: Sequence[Strip], begin_s: float, end_s: float, title: str, moment: Callable[[int], str]
) -> str:
    """The same as a picture: light or dark as its viewer, each bar with its figures as a tooltip."""
    begin, number, width = _frame(strips, begin_s, end_s, _MOST_BARS)
    reasons = sorted({reason for strip in strips for reason in strip.timeline.lost})
    colours = {reason: _COLOURS[at % len(_COLOURS)] for at, reason in enumerate(reasons)}
    height = _TOP + _ROW * len(strips) + 44
    parts = [
        f'<svg xmlns="http://www.w3.org/2000/svg" role="img" viewBox="0 0 {_WIDTH + 2 * _LEFT} {height}" '
        f'width="{_WIDTH + 2 * _LEFT}" height="{height}">',
        f"<title>{escape(title)}</title><style>{_STYLE}</style>",
        f'<text x="{_LEFT}" y="18" class="name">{escape(title)}</text>',
    ]
    x = float(_LEFT)
    for reason in reasons:
        parts.append(
            f'<rect x="{x:g}" y="26" width="10" height="10" fill="{colours[reason]}"/>'
            f'<text x="{x + 14:g}" y="35" class="soft">{escape(reason)}</text>'
        )
        x += 30 + 7 * len(reason)
    for row, strip in enumerate(strips):
        parts += _strip(strip, _TOP + row * _ROW, (begin, number, width), colours, moment)
    parts += _axis(height - 30, number * width, moment(begin))
    return "\n".join((*parts, "</svg>", ""))


def _strip(
    strip: Strip, y: int, frame: tuple[int, int, int], colours: dict[str, str], moment: Callable[[int], str]
) -> list[str]:
    begin, number, width = frame
    end = begin + number * width
    bars = strip.timeline.bars(begin, end, number)
    top, step, bottom = max(bars, default=0.0), _WIDTH / number, y + 24 + _BAR_HEIGHT
    heights = [0.0] * number
    parts = [
        f'<text x="{_LEFT}" y="{y + 16}"><tspan class="name">{escape(strip.name)}</tspan> '
        f'<tspan class="soft">{escape(strip.note)}</tspan></text>',
        f'<line x1="{_LEFT}" x2="{_LEFT + _WIDTH}" y1="{bottom}" y2="{bottom}"/>',
    ]
    for reason, colour in colours.items():
        for place, count in enumerate(strip.timeline.bars(begin, end, number, reason)):
            if not count:
                continue
            tall = max(1.0, count / top * _BAR_HEIGHT)
            heights[place] += tall
            at_s = begin + place * width
            parts.append(
                f'<rect x="{_LEFT + place * step:.2f}" y="{bottom - heights[place]:.2f}" '
                f'width="{max(1.0, step - 0.5):.2f}" height="{tall:.2f}" fill="{colour}">'
                f"<title>{escape(f'{moment(at_s)}, {width} s: {count:.0f} {reason}')}</title></rect>"
            )
    return parts


def _axis(y: int, span_s: int, start: str) -> list[str]:
    step = tick_step(span_s)
    parts = []
    for at_s in range(0, span_s + 1, step):
        x = _LEFT + at_s / span_s * _WIDTH
        anchor = "start" if at_s == 0 else "end" if at_s == span_s else "middle"
        parts.append(
            f'<line x1="{x:.1f}" x2="{x:.1f}" y1="{y - 10}" y2="{y - 4}"/>'
            f'<text x="{x:.1f}" y="{y + 8}" class="soft" text-anchor="{anchor}">{at_s} s</text>'
        )
    parts.append(f'<text x="{_LEFT}" y="{y + 24}" class="soft">{escape(f"seconds since {start}")}</text>')
    return parts


def _reasons(lost: dict[str, int]) -> str:
    return ", ".join(f"{count} {reason}" for reason, count in sorted(lost.items()) if count)
