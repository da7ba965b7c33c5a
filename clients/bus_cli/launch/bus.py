"""The choice of the bus for the processes of a launch."""

import os
from argparse import Namespace

from bus.process.address import domain_id, socket_path

__all__ = ["export"]


def export(args: Namespace) -> None:
    """Put --domain and --socket into the environment, which the processes inherit."""
    if args.domain is not None:
        os.environ["BUSD_DOMAIN"] = str(domain_id(args.domain))
        os.environ.pop("BUSD_SOCKET", None)  # it would override the domain
    if args.socket is not None:
        os.environ["BUSD_SOCKET"] = str(socket_path(args.socket))
