"""`bus bridge ros2`: connects the bus to the nodes of ROS 2 through DDS or zenoh."""

from argparse import ArgumentParser, Namespace

from bus.base.optional import how_to_install
from bus_cli.bridge.bridgeargs import add_bridge_arguments, add_certificate_arguments, run_bridge, tls_of

_EPILOG = f"""\
Topics, services, actions and parameters cross. DDS has no protection: choose an --interface with a
network that you trust. Topics are fastest with cyclonedds: {how_to_install("cyclonedds")}
Nodes with rmw_zenoh need --rmw zenoh, and: {how_to_install("eclipse-zenoh", "xxhash")}
See docs/bridge.md
"""


def add_arguments(parser: ArgumentParser) -> None:
    parser.epilog = _EPILOG
    group = parser.add_argument_group("ROS 2")
    group.add_argument(
        "--domain-id", type=int, metavar="N", help="domain of ROS 2 (default: $ROS_DOMAIN_ID, else 0)"
    )
    group.add_argument(
        "--rmw", choices=("dds", "zenoh"), help="the middleware of ROS 2's nodes (default: dds)"
    )
    group = parser.add_argument_group("DDS")
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
        "--discovery-server",
        action="append",
        metavar="ADDRESS",
        help="a Discovery Server of Fast DDS, as in 10.0.0.2:11811, in addition to $ROS_DISCOVERY_SERVER; "
        "may be given several times",
    )
    group.add_argument(
        "--distro",
        choices=("auto", "humble"),
        help="format of ROS 2's graph messages: Humble's, or detected (default: auto)",
    )
    group.add_argument(
        "--carrier",
        choices=("auto", "cyclonedds", "rtps"),
        help="what carries topics (default: auto, which is cyclonedds if it is installed; else, and with a "
        "Discovery Server, busd's own RTPS)",
    )
    group = parser.add_argument_group("zenoh (--rmw zenoh)")
    group.add_argument(
        "--connect",
        action="append",
        metavar="ADDRESS",
        help="a router or node of ROS 2 (default: tcp/localhost:7447); may be given several times",
    )
    group.add_argument(
        "--router",
        action="append",
        metavar="ADDRESS",
        help="a router, as on another machine, that passes on all messages; of several, one is used",
    )
    group.add_argument(
        "--listen",
        action="append",
        metavar="ADDRESS",
        help="wait for nodes of ROS 2 at this address; may be given several times",
    )
    add_certificate_arguments(group)
    add_bridge_arguments(parser, "ros2")


def main(args: Namespace) -> int:
    """Run the bridge until Ctrl-C."""
    flags = {
        "domain_id": args.domain_id,
        "interface": args.interface,
        "peers": args.peer,
        "discovery_servers": args.discovery_server,
        "distro": args.distro,
        "carrier": args.carrier,
        "rmw": args.rmw,
        "connect": args.connect,
        "router": args.router,
        "listen": args.listen,
        "insecure": args.insecure,
        "tls": tls_of(args),
    }
    return run_bridge(args, "ros2", flags)
