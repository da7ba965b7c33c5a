"""`bus bridge ros2`: connects the bus to the nodes of ROS 2 through DDS."""

from argparse import ArgumentParser, Namespace

from bus.base.optional import how_to_install
from bus_cli.bridge.bridgeargs import add_bridge_arguments, run_bridge

_EPILOG = f"""\
Topics, services, actions and parameters cross. DDS has no protection: choose an --interface with a
network that you trust. Topics are fastest with cyclonedds: {how_to_install("cyclonedds")}
See docs/bridge.md
"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = _EPILOG
    group = parser.add_argument_group("ROS 2")
    group.add_argument(
        "--domain-id", type=int, metavar="N", help="domain of DDS (default: $ROS_DOMAIN_ID, else 0)"
    )
    group.add_argument(
        "--interface",
        metavar="NAME",
        help="network interface, by name or address (default: this machine only)",
    )
    group.add_argument(
        "--peer",
        action="append",
        metavar="ADDRESS",
        help="a machine that multicast does not reach; may be given several times",
    )
    group.add_argument(
        "--distro",
        choices=("auto", "humble"),
        help="format of ROS 2's graph messages: Humble's, or detected (default: auto)",
    )
    group.add_argument(
        "--carrier",
        choices=("auto", "cyclonedds", "rtps"),
        help="what carries topics: cyclonedds if it is installed, or busd's own RTPS (default: auto)",
    )
    add_bridge_arguments(parser, "ros2")


def main(args: Namespace) -> int:
    """Run the bridge until Ctrl-C."""
    flags = {
        "domain_id": args.domain_id,
        "interface": args.interface,
        "peers": args.peer,
        "distro": args.distro,
        "carrier": args.carrier,
    }
    return run_bridge(args, "ros2", flags)
