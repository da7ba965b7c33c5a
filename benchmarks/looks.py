"""The appearance of a series in pictures and tables: its kind and its colour. Only knows systems' names."""

from typing import NamedTuple

from benchmarks.systems import SYSTEMS, System, of_kind

POLLING = "polling"
"""The word in the name of a series that polls instead of waiting for events."""

OURS, SOCKET, GREY = "#0A7BC8", "#56B4E9", "#8A8A8A"
# The palette of Okabe and Ito, which colour-blind people can distinguish; the markers differ as well.
_RIVALS = ("#E69F00", "#009E73", "#D55E00", "#CC79A7", "#A6761D", "#7F6FC6", "#C2364F", "#8C8C00")
_KINDS = {"ours": OURS, "floor": GREY, "direct": "#E69F00", "brokered": "#CC79A7"}
_MARKERS = "osD^vP*Xph<>d8"


class Look(NamedTuple):
    """The style of a series: `colour` as #RRGGBB, `marker` and `dashes` in matplotlib's words."""

    colour: str
    marker: str
    dashes: str
    is_ours: bool = False


def system_of(series: str) -> System | None:
    """The system of a series: the longest matching name, because "pyzmq" also begins "pyzmq, ... proxy"."""
    found = [one for one in SYSTEMS if series == one.name or series.startswith(f"{one.name}, ")]
    return max(found, key=lambda one: len(one.name), default=None)


def is_main(series: str) -> bool:
    """Whether it is the standard use of its system, waiting for events, and not a variant."""
    system = system_of(series)
    return system is not None and series.removeprefix(system.name) in ("", ", event-driven", ", blocking")


def kind_colour(series: str) -> str:
    """The colour for the kind of a system: ours, a limit, a rival without or with a broker."""
    system = system_of(series)
    look = look_of(series)
    return look.colour if system is None or look.is_ours else _KINDS[system.kind]


def is_polling(series: str) -> bool:
    return POLLING in series


def look_of(series: str) -> Look:
    """The style of a series, the same in every picture: ours blue, limits grey, rivals with a broker
    dashed."""
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
