"""How a series looks in pictures and tables: its kind and its colour. Knows only the systems' names."""

from typing import NamedTuple

from benchmarks.systems import SYSTEMS, System, of_kind

POLLING = "polling"
"""The word in a series' name that says that it does not wait for events."""

OURS, SOCKET, GREY = "#0A7BC8", "#56B4E9", "#8A8A8A"
# Okabe and Ito's, which colour-blind people can tell apart; the markers differ as well.
_RIVALS = ("#E69F00", "#009E73", "#D55E00", "#CC79A7", "#A6761D", "#7F6FC6", "#C2364F", "#8C8C00")
_KINDS = {"ours": OURS, "floor": GREY, "direct": "#E69F00", "brokered": "#CC79A7"}
_MARKERS = "osD^vP*Xph<>d8"


class Look(NamedTuple):
    """What is drawn for a series: `colour` as #RRGGBB, `marker` and `dashes` in matplotlib's words."""

    colour: str
    marker: str
    dashes: str
    is_ours: bool = False


def system_of(series: str) -> System | None:
    """The system whose series it is; the longest name that fits, as "pyzmq" begins "pyzmq, ... proxy"."""
    found = [one for one in SYSTEMS if series == one.name or series.startswith(f"{one.name}, ")]
    return max(found, key=lambda one: len(one.name), default=None)


def is_main(series: str) -> bool:
    """Whether it is how its system is used, waiting for events, and no variant of that."""
    system = system_of(series)
    return system is not None and series.removeprefix(system.name) in ("", ", event-driven", ", blocking")


def kind_colour(series: str) -> str:
    """Where a name stands beside it: ours, a limit, a rival without or with a broker."""
    system = system_of(series)
    look = look_of(series)
    return look.colour if system is None or look.is_ours else _KINDS[system.kind]


def is_polling(series: str) -> bool:
    return POLLING in series


def look_of(series: str) -> Look:
    """The same for one series in every picture: ours blue, limits grey, brokered rivals dashed."""
    system = system_of(series)
    if system is None or system.kind == "floor":
        return Look(GREY, ".", ":")
    if system.kind == "ours":
        is_socket, is_plain = system.route == "socket", system.takes_by == "blocking"
        marker = "s" if is_socket else "v" if is_plain else "o"
        return Look(SOCKET if is_socket else OURS, marker, "--" if is_plain else "-", is_ours=True)
    at = of_kind("direct", "brokered").index(system)
    dashes = "--" if system.kind == "brokered" else "-"
    return Look(_RIVALS[at % len(_RIVALS)], _MARKERS[at % len(_MARKERS)], dashes)
