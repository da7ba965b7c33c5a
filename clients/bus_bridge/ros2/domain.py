"""The domain of ROS 2 that a bridge joins."""

import os
from typing import Final

from bus_bridge.errors import BridgeError

__all__ = ["MAX_DOMAIN", "chosen_domain"]

MAX_DOMAIN: Final = 232
"""The highest domain: above it, port numbers of DDS would be too high."""


def chosen_domain(domain_id: int | None) -> int:
    """The domain to use: `domain_id`, or $ROS_DOMAIN_ID if that is None, else 0. Raises BridgeError if
    $ROS_DOMAIN_ID is not a number."""
    if domain_id is not None:
        return domain_id
    text = os.environ.get("ROS_DOMAIN_ID", "")
    if text and not (text.isascii() and text.isdigit()):
        raise BridgeError(f"ROS_DOMAIN_ID must be a number from 0 to {MAX_DOMAIN}, not '{text}'")
    return int(text or "0")
