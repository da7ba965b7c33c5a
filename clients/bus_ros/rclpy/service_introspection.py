"""The level of detail about requests and answers that a client or service publishes as service events."""

from enum import IntEnum

__all__ = ["ServiceIntrospectionState"]


class ServiceIntrospectionState(IntEnum):
    """No events; events with time and client; also with their contents."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2
