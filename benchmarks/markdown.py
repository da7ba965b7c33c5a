"""A result as Markdown: the report, the tables beside it, and the README's short table. Pure: makes text.

Knows which figures matter most. Draws no pictures, only names their files.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from benchmarks.figures import Spread
from benchmarks.looks import is_main, system_of
from benchmarks.pictures import Picture, available
from benchmarks.plan import BENCHMARKS
from benchmarks.report import Comparison, Result, Row, Section, goal, number, spread
from benchmarks.systems import (
    BUS,
    BUS_BLOCKING,
    BUS_SOCKET,
    C_FLOOR,
    FLOOR,
    RIVALS,
    TUNED,
    System,
)
from bus_cli.bench.figures import bytes_text

FOLDER = "pictures"
"""The folder of the pictures, beside the report."""
TABLES = "TABLES.md"
"""The file of the tables, beside the report."""
SPEED = ("<!-- speed -->", "<!-- /speed -->")
"""The marks before and after the table in the README."""

_MATRICES = {
    "latency": ("p50", "p99"),
    "throughput": ("per_s", "bytes_per_s", "lost"),
    "fanout": ("deliveries_per_s", "last_p50"),
}
_SHORT_ROWS = 24


class _Essential(NamedTuple):
    """A column of the short tables; `at` is None if the section has one row for each system.

    `way`: selects rows whose series is the system's name with this ending.
    """

    heading: str
    section: str
    key: str
    at: float | None
    higher_is_better: bool = False
    is_in_readme: bool = True
    way: str = ""


_ESSENTIALS = (
    _Essential("latency 64 B: p50 µs", "latency", "p50", 64),
    _Essential("p99 µs", "latency", "p99", 64),
    _Essential("1 MiB: p50 µs", "latency", "p50", 1 << 20),
    _Essential("1 MiB, malloc alike: p50 µs", "latency", "p50", 1 << 20, way=TUNED),
    _Essential("messages/s of 64 B", "throughput", "per_s", 64, True),
    _Essential("bytes/s by 64 KiB", "throughput", "bytes_per_s", 1 << 16, True),
    _Essential("deliveries/s to 8", "fanout", "deliveries_per_s", 8, True),
    _Essential("CPU s per 100k", "cost", "cpu", None, is_in_readme=False),
    _Essential("first message ms", "startup", "ms", None, is_in_readme=False),
)


def report_of(result: Result, source: str) -> str:
    """The report. `source` is the path of the result's file, relative to the report's folder."""
    parts = [
        "# Benchmark report",
        f"Made by `make bench-report RESULT=benchmarks/{source}` from [{source}]({source}); edit neither. "
        "How it is measured is in [README.md](README.md), and every figure in "
        f"[{TABLES}]({TABLES}). {_reading(result)}",
        _facts(result),
        *_in_short(result),
        *_headlines(result),
        *_pictures(result),
        *_goals(result),
        *_troubles(result),
    ]
    return "\n\n".join(parts) + "\n"


def tables_of(result: Result, source: str) -> str:
    """The tables of all sections, beside the report. `source` as in `report_of`."""
    parts = [
        "# Benchmark tables",
        f"Every figure of [the benchmark report](REPORT.md), made with it from [{source}]({source}); "
        f"edit neither. {_reading(result)}",
    ]
    for section in result.sections:
        parts += _section(section)
    return "\n\n".join(parts) + "\n"


def _reading(result: Result) -> str:
    return (
        "Figures are `median (min - max)` over the repetitions "
        f"({result.repetitions} of latency and throughput); compare those of one run only."
    )


def speed_of(result: Result) -> str:
    """The text between the marks in the README: busd by both routes, the best rivals, and a limit."""
    columns = [one for one in _measured(result) if one.is_in_readme]
    if not columns:
        return "No result yet."
    machine = result.machine
    kind = "quick" if result.is_quick else "full"
    return "\n\n".join(
        [
            _table(["", *(one.heading for one in columns)], _speed_rows(result, columns)),
            "The best rival is that of each column. In brackets: how many times better busd by shared memory "
            "is; **bold** if a rival is ahead. The limit is no rival: it does less, and wakes its reader "
            f"for each message. {_like_for_like(columns)}"
            f"Medians of the {kind} run of {result.began[:10]} at commit {machine.commit or 'unknown'}: "
            f"{machine.processor}, {machine.cpus} CPUs, {'virtual, ' if machine.is_virtual else ''}"
            f"{machine.kernel}, {machine.python}. Each system, CPU time, start, pictures, "
            "the measurements that busd loses, and how to measure again: "
            "[benchmarks/REPORT.md](benchmarks/REPORT.md).",
        ]
    )


def _like_for_like(columns: Sequence[_Essential]) -> str:
    if not any(one.way for one in columns):
        return ""
    return (
        "The clock starts with the complete message at hand. The C library keeps the memory of long messages "
        "for busd, because busd tells it to; others pay page faults. *Malloc alike* is with the same "
        "`MALLOC_*` in the environment of all. "
    )


def between_marks(text: str) -> str | None:
    """The text between the marks in `text`; None without marks."""
    _, begin, rest = text.partition(SPEED[0])
    inside, end, _ = rest.partition(SPEED[1])
    return inside.strip() if begin and end else None


def with_speed(text: str, speed: str) -> str:
    """`text` with `speed` between its marks. Raises ValueError if it has none."""
    if between_marks(text) is None:
        raise ValueError(f"no {SPEED[0]} ... {SPEED[1]}")
    before, _, rest = text.partition(SPEED[0])
    return f"{before}{SPEED[0]}\n{speed}\n{SPEED[1]}{rest.partition(SPEED[1])[2]}"


# --- the report


def _facts(result: Result) -> str:
    machine = result.machine
    programs = ", ".join(
        f"{name} {version}" for name, version in (machine.packages | machine.servers).items()
    )
    kind = "a quick one, which is no measurement" if result.is_quick else "a full one"
    took_min = round(sum(one.took_s for one in result.sections) / 60)
    rows = [
        ["run", f"{result.began}, {kind}" + (f", {took_min} min" if took_min else "")],
        ["commit", machine.commit or "unknown"],
        ["machine", f"{machine.hardware()}; load {machine.load:.2f} at the start"],
        ["Python", machine.python],
        ["versions", programs],
        ["again", "`make bench`, and `make bench-compare A=... B=...` to see what changed"],
    ]
    return _table(["", ""], rows)


def _in_short(result: Result) -> Iterator[str]:
    columns = _measured(result)
    if columns:
        yield "## In short"
        yield _essentials(result, columns, (BUS, BUS_BLOCKING, BUS_SOCKET, *RIVALS, FLOOR, C_FLOOR))
        yield (
            "In brackets: how many times better busd by shared memory is; **bold** if a rival is ahead. "
            "A limit is no rival: it does less."
        )


def _headlines(result: Result) -> Iterator[str]:
    """The goals of `benchmarks.goals`, each with its result, met or missed."""
    rows, asked = [], [one for part in result.sections for one in part.comparisons if one.headline]
    if not asked:
        return
    for one in asked:
        rows.append(
            [_text(one.headline), spread(one.value), goal(one), "met" if one.is_met else "**missed**"]
        )
    met = sum(one.is_met for one in asked)
    yield "## Goals"
    yield f"{met} of {len(asked)} are met. Ratios are made within a repetition."
    yield _table(["busd / whom it is compared with", "median (min - max)", "goal", ""], rows)


def _pictures(result: Result) -> Iterator[str]:
    pictures = available(result)
    if pictures:
        yield "## Pictures"
    yield from (_picture(one) for one in pictures)


def _goals(result: Result) -> Iterator[str]:
    asked = [
        (part.name, one)
        for part in result.sections
        for one in part.comparisons
        if one.has_goal and not one.headline
    ]
    missed = [(name, one) for name, one in asked if not one.is_met]
    yield "## Where it loses"
    if not asked:
        yield "Nothing was asked for in this run."
        return
    count = f"{len(asked) - len(missed)} of {len(asked)} goals are met."
    if not missed:
        yield f"{count} None is missed."
        return
    yield f"{count} These are not:"
    yield "\n".join(
        f"- {name}: {_text(one.name)}: **{spread(one.value)}**, goal {goal(one)}" for name, one in missed
    )


def _troubles(result: Result) -> Iterator[str]:
    """The cases that could not be measured, once for each system and reason."""
    found: dict[tuple[str, str], list[str]] = {}
    for section in result.sections:
        for row in section.rows:
            if row.trouble:
                found.setdefault((row.series or row.name, row.trouble), []).append(_where(section, row))
    absent = [name for name in BENCHMARKS if result.section(name) is None]
    yield "## What is missing"
    if absent:
        yield f"These benchmarks: {', '.join(absent)}."
    if not found:
        yield "Every case of the others was measured." if absent else "Nothing: every case was measured."
        return
    yield "\n".join(
        f"- {_text(name)}: {_text(trouble)} (in {', '.join(dict.fromkeys(places))})"
        for (name, trouble), places in found.items()
    )


def _where(section: Section, row: Row) -> str:
    return f"{section.name} at {_place(section, row.at)}" if row.at else section.name


def _place(section: Section, at: float) -> str:
    return bytes_text(int(at)) if section.axis.endswith(" B") else f"{at:g}"


def _section(section: Section) -> Iterator[str]:
    yield f"## {_text(section.title)}"
    headings = section.headings()
    matrices = [key for key in _MATRICES.get(section.name, ()) if _has_matrix(section, key)]
    for key in matrices:
        yield f"**{_text(headings[key])}**"
        yield _matrix(section, key)
    keys = [key for key in headings if any(key in row.figures for row in section.rows)]
    rows = [
        [_text(row.name), *(_figure(row.figures, key) for key in keys)] for row in section.rows if row.figures
    ]
    everything = _table(["median (min - max)", *(headings[key] for key in keys)], rows)
    if matrices or len(rows) > _SHORT_ROWS:
        everything = f"<details><summary>all figures</summary>\n\n{everything}\n\n</details>"
    yield everything
    if section.comparisons:
        yield _comparisons(section.comparisons)
    if section.notes:
        yield "\n".join(f"- {_text(note)}" for note in section.notes)


def _picture(picture: Picture) -> str:
    files = picture.files()
    return (
        f'<picture><source media="(prefers-color-scheme: dark)" srcset="{FOLDER}/{files["dark"]}">'
        f'<img alt="{picture.alt}" src="{FOLDER}/{files["light"]}"></picture>'
    )


def _has_matrix(section: Section, key: str) -> bool:
    return any(len(points) > 1 for points in section.lines(key).values())


def _matrix(section: Section, key: str) -> str:
    """The medians of each series by the axis; ours in bold."""
    lines = section.lines(key)
    places = sorted({at for points in lines.values() for at in points})
    rows = []
    for series, points in lines.items():
        name = f"**{_text(series)}**" if _is_ours(series) else _text(series)
        rows.append([name, *(number(points[at].median) if at in points else "-" for at in places)])
    return _table([section.axis, *(_place(section, at) for at in places)], rows)


def _is_ours(series: str) -> bool:
    system = system_of(series)
    return system is not None and system.kind == "ours"


def _comparisons(comparisons: Iterable[Comparison]) -> str:
    rows = []
    for one in comparisons:
        verdict = ("met" if one.is_met else "**NOT met**") if one.has_goal else ""
        rows.append([_text(one.name), spread(one.value), goal(one), verdict])
    return _table(["", "median (min - max)", "goal", ""], rows)


def _figure(figures: Mapping[str, Spread], key: str) -> str:
    return spread(figures[key]) if key in figures else "-"


# --- the short tables: systems by essential figures, with ratios


def _measured(result: Result) -> list[_Essential]:
    return [one for one in _ESSENTIALS if _essential(result, one, BUS) is not None]


def _speed_rows(result: Result, columns: Sequence[_Essential]) -> Iterator[list[str]]:
    for name, kind, systems in (
        (f"**{BUS.name}**", "", (BUS,)),
        (f"**{BUS_SOCKET.name}**", "", (BUS_SOCKET,)),
        ("best rival with a broker", "brokered", RIVALS),
        ("best rival without", "direct", RIVALS),
        (_named(C_FLOOR), "", (C_FLOOR,)),
    ):
        best = [
            _best(result, one, [system for system in systems if kind in ("", system.kind)]) for one in columns
        ]
        if any(best):
            cells = [
                _cell(result, one, system) if system else "-"
                for one, system in zip(columns, best, strict=True)
            ]
            of = [f" {_text(system.name)}" if kind and system else "" for system in best]
            yield [name, *(f"{cell}{rival}" for cell, rival in zip(cells, of, strict=True))]


def _best(result: Result, one: _Essential, systems: Iterable[System]) -> System | None:
    found = [(value, system) for system in systems if (value := _essential(result, one, system)) is not None]
    choose = max if one.higher_is_better else min
    return choose(found, key=lambda pair: pair[0])[1] if found else None


def _essentials(result: Result, columns: Sequence[_Essential], systems: Iterable[System]) -> str:
    rows = []
    for system in systems:
        if any(_essential(result, one, system) is not None for one in columns):
            name = f"**{system.name}**" if system.kind == "ours" else _named(system)
            rows.append([name, *(_cell(result, one, system) for one in columns)])
    return _table(["", *(one.heading for one in columns)], rows)


def _essential(result: Result, one: _Essential, system: System) -> float | None:
    row = _row(result, one, system)
    return row.figures[one.key].median if row is not None else None


def _row(result: Result, one: _Essential, system: System) -> Row | None:
    section = result.section(one.section)
    rows = section.rows if section is not None else []
    for row in rows:
        fits = one.at is None or row.at == one.at
        way = row.series == f"{system.name}, {one.way}" if one.way else is_main(row.series)
        if fits and one.key in row.figures and way and system_of(row.series) == system:
            return row
    return None


def _cell(result: Result, one: _Essential, system: System) -> str:
    row = _row(result, one, system)
    ours = _essential(result, one, BUS)
    if row is None or not ours:
        return "-"
    value = row.figures[one.key].median
    lost = row.figures.get("lost")
    text = number(value) + (f", {number(lost.median)} % lost" if lost and lost.median else "")
    if system == BUS or not value:
        return f"**{text}**"
    times = ours / value if one.higher_is_better else value / ours
    ratio = f"{number(times)}x"
    is_rival = system.kind in ("direct", "brokered")
    return f"{text} (**{ratio}**)" if is_rival and times < 1 else f"{text} ({ratio})"


def _named(system: System) -> str:
    words = {"brokered": " (a broker)", "floor": " (a limit)"}
    return _text(system.name) + words.get(system.kind, "")


# --- Markdown


def _table(headings: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [headings, ["---", *["---:"] * (len(headings) - 1)], *rows]
    if all(len(line) == 2 for line in lines):
        lines[1] = ["---", "---"]
    return "\n".join(f"| {' | '.join(cells)} |" for cells in lines)


def _text(text: str) -> str:
    """Escape characters that have a meaning in Markdown."""
    for mark in "|*<":
        text = text.replace(mark, f"\\{mark}")
    return text
