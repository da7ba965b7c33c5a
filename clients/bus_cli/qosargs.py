"""The --qos-... options, and the choice of a subscription's profile from the publishers' offers."""

from argparse import ArgumentParser, Namespace

from msgspec.structs import replace

from bus.graph import Graph
from bus.qos import CHOICES, PRESETS, Durability, QoSProfile, Reliability
from bus_cli.output import complain

_KINDS = {one.name: one.kind for one in CHOICES if one.kind is not None}
_SYSTEM_DEFAULT = "system_default"


def add_qos_arguments(parser: ArgumentParser, verb: str, preset: str) -> None:
    """Add the options. `verb` names the tool's use of the profile; `preset` has the defaults."""
    group = parser.add_argument_group("quality of service")
    group.add_argument(
        "--qos-profile",
        choices=PRESETS,
        metavar="PRESET",
        help=f"Quality of service preset profile to {verb} with (default: {preset}): {', '.join(PRESETS)}",
    )
    group.add_argument("--qos-depth", metavar="N", type=int, help=f"Queue size setting to {verb} with")
    for name, kind in _KINDS.items():
        choices = [_SYSTEM_DEFAULT, *(member.value for member in kind)]
        subject = "History of samples" if name == "history" else f"Quality of service {name}"
        group.add_argument(
            f"--qos-{name}",
            choices=choices,
            metavar="POLICY",
            help=f"{subject} setting: {', '.join(choices)}",
        )
    group.add_argument(
        "--qos-liveliness-lease-duration-seconds",
        metavar="S",
        type=float,
        help="Quality of service liveliness lease duration setting",
    )
    parser.set_defaults(qos_preset=preset)


def given_profile(args: Namespace) -> QoSProfile:
    """The preset, changed by the options. Raises ConfigurationError for a value out of range."""
    base = PRESETS[args.qos_profile or args.qos_preset]
    changes = {
        "depth": args.qos_depth,
        "liveliness_lease_duration": args.qos_liveliness_lease_duration_seconds,
        **{name: getattr(args, f"qos_{name}") for name in _KINDS},
    }
    system = PRESETS[_SYSTEM_DEFAULT]
    return replace(
        base,
        **{
            name: getattr(system, name) if value == _SYSTEM_DEFAULT else value
            for name, value in changes.items()
            if value is not None
        },
    )


def choose_profile(graph: Graph, topic: str, args: Namespace) -> QoSProfile:
    """The profile of the options; without options, a profile to match all present publishers of `topic`.

    It follows choose_qos of ros2topic: reliable if all publishers are, and transient local if all publishers
    are. If the publishers differ, it prints a warning.
    """
    profile = given_profile(args)
    offers = [publisher.qos for publisher in graph.publishers_of(topic)]
    if not offers or args.qos_profile or profile != PRESETS[args.qos_preset]:
        return profile
    reliable = [offer.reliability is Reliability.RELIABLE for offer in offers]
    if any(reliable) and not all(reliable):
        complain(
            "Some, but not all, publishers are offering QoSReliabilityPolicy.RELIABLE. Falling back to "
            "QoSReliabilityPolicy.BEST_EFFORT as it will connect to all publishers"
        )
    lasting = [offer.durability is Durability.TRANSIENT_LOCAL for offer in offers]
    if any(lasting) and not all(lasting):
        complain(
            "Some, but not all, publishers are offering QoSDurabilityPolicy.TRANSIENT_LOCAL. Falling back to "
            "QoSDurabilityPolicy.VOLATILE as it will connect to all publishers"
        )
    return serving_all(profile, offers)


def serving_all(profile: QoSProfile, offers: list[QoSProfile]) -> QoSProfile:
    """`profile`, but reliable if all `offers` are, and transient local if all are. So it matches them."""
    reliable = all(offer.reliability is Reliability.RELIABLE for offer in offers)
    lasting = all(offer.durability is Durability.TRANSIENT_LOCAL for offer in offers)
    if not offers:
        return profile
    return replace(
        profile,
        reliability=Reliability.RELIABLE if reliable else Reliability.BEST_EFFORT,
        durability=Durability.TRANSIENT_LOCAL if lasting else Durability.VOLATILE,
    )
