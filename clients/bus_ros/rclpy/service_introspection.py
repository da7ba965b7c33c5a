"""How much a client or a service tells of its requests and answers on `<service>/_service_event`."""

from enum import IntEnum

__all__ = ["ServiceIntrospectionState"]


class ServiceIntrospectionState(IntEnum):
    """Nothing; that there was one, when and whose; also what it said."""

    OFF = 0
    METADATA = 1
    CONTENTS = 2
