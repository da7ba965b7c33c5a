"""Every error of busd, as a tree.

    BusError
    ├── ConfigurationError (ValueError)   a bad name, QoS profile or configuration
    │   ├── CommandLineError              the arguments after --ros-args can't be used
    │   └── StartError                    the environment can't be used: BUSD_DOMAIN, the limit of open files
    ├── ParameterError (ValueError)       a parameter can't be declared, read or set this way
    ├── MessageTypeError (TypeError)      a message of the wrong class, or a field of the wrong type
    ├── PayloadTooLarge (ValueError)      size_bytes, limit_bytes
    ├── QuotaExceeded                     resource, used, limit
    ├── AccessDenied                      busd's access rules don't let this user do that
    ├── SharedMemoryError (OSError)       the machine has no memory for a publisher's ring
    ├── ProtocolError
    │   ├── LocalProtocolError            this side asked for something that is not allowed now
    │   └── RemoteProtocolError           the other side broke the protocol
    ├── ConnectionClosed (ConnectionError)
    │   └── BrokerUnavailable             no busd answers at the socket
    ├── ServiceError                      a service could not answer: its callback raised
    ├── ServiceUnavailable                no server exists, or all left before they answered
    └── ForkError (RuntimeError)          a node was used in a child of the process that made it

Errors are for faults. Expected outcomes (nothing to take, a message replaced because a queue was full, no
room to publish) are return values or counters. Timeouts are the built-in TimeoutError.
"""

from typing import TypeVar

from bus.base.printable import printable

__all__ = [
    "AccessDenied",
    "BrokerUnavailable",
    "BusError",
    "CommandLineError",
    "ConfigurationError",
    "ConnectionClosed",
    "ForkError",
    "LocalProtocolError",
    "MessageTypeError",
    "ParameterError",
    "PayloadTooLarge",
    "ProtocolError",
    "QuotaExceeded",
    "RemoteProtocolError",
    "ServiceError",
    "ServiceUnavailable",
    "SharedMemoryError",
    "StartError",
    "again",
]

E = TypeVar("E", bound="BusError")


class BusError(Exception):
    """Base of every error that busd raises on purpose. `except bus.BusError` catches them all.

    Its text may contain texts of other processes. str(), which tracebacks and logs show, has no control
    characters except newlines and tabs.
    """

    def __str__(self) -> str:
        return printable(super().__str__())


def again(error: E) -> E:
    """A copy of `error`, to be raised.

    An error that is raised several times would keep the frames of each time.
    """
    copy = type(error).__new__(type(error), *error.args)
    copy.__dict__.update(error.__dict__)
    return copy


class ConfigurationError(BusError, ValueError):
    """A value that the user gave is not allowed: a name, a QoS profile, a remap rule, a setting."""

    def __init__(self, message: str, *, index: int | None = None) -> None:
        super().__init__(message)
        self.index = index
        """If the value is a name, the offset of the first wrong character, else None."""


class CommandLineError(ConfigurationError):
    """The arguments after --ros-args can't be used: a mistake in the command that started the program.

    If the program does not catch it, the program ends with its text in one line, without a traceback.
    """


class StartError(ConfigurationError):
    """The program's environment keeps it from the bus: a variable that chooses the bus (BUSD_DOMAIN,
    BUSD_SOCKET, XDG_RUNTIME_DIR), or too low a limit of open files (`ulimit -n`).

    If the program does not catch it, the program ends with its text in one line, without a traceback.
    """


class MessageTypeError(BusError, TypeError):
    """A message does not have the type of its topic; the text names the field's path."""


class ParameterError(BusError, ValueError):
    """A parameter can't be declared, read or set this way; the text names it, the value and the rule."""

    def __init__(self, name: str, message: str) -> None:
        super().__init__(message)
        self.name = name
        """The parameter's name; several are joined by commas."""


class PayloadTooLarge(BusError, ValueError):
    """An encoded message is larger than the topic allows."""

    def __init__(self, topic: str, *, size_bytes: int, limit_bytes: int) -> None:
        super().__init__(
            f"message on '{topic}' has {size_bytes} bytes, the limit is {limit_bytes}; in busd.toml it is "
            "message_bytes of [limits], or max_message_bytes of a rule in [[topics]]"
        )
        self.topic = topic
        """The topic's full name."""
        self.size_bytes = size_bytes
        """The message's size."""
        self.limit_bytes = limit_bytes
        """The topic's limit."""


class QuotaExceeded(BusError):
    """busd refused because this process already holds as much of a resource as it may (see busd.toml)."""

    def __init__(self, resource: str, *, used: int, limit: int) -> None:
        super().__init__(f"{resource}: {used} of {limit} in use; busd's limit can be raised in busd.toml")
        self.resource = resource
        """The name of the resource, such as `endpoints`."""
        self.used = used
        """How much of it this process holds."""
        self.limit = limit
        """How much it may hold."""


class AccessDenied(BusError):
    """busd refused because its access rules (busd.toml) don't let this process's user do that."""


class SharedMemoryError(BusError, OSError):
    """The machine has too little memory, or this process no free descriptor, for shared memory.

    If `publish` raises it, the message was not published; the publisher is still usable.
    """


class ProtocolError(BusError):
    """One side broke the rules of the wire; the two subclasses say which."""


class LocalProtocolError(ProtocolError):
    """This side asked for something that is not allowed now: a second loan, or too many calls at once."""


class RemoteProtocolError(ProtocolError):
    """The other side sent something that is not allowed: it is faulty or has another version."""


class ConnectionClosed(BusError, ConnectionError):
    """Something was closed: the object itself, its node, or the connection to busd for good.

    A restart of busd closes nothing: the library connects again, and requests wait meanwhile.
    """


class BrokerUnavailable(ConnectionClosed):
    """No busd answers at the socket, and none could or should be started. `bus doctor` says why."""


class ServiceError(BusError):
    """A service could not answer a call; the text is the server's."""

    def __init__(self, service: str, text: str) -> None:
        super().__init__(f"service '{service}' failed: {text}")
        self.service = service
        """The service's full name."""
        self.text = text
        """The server's text: type and text of the exception there."""


class ServiceUnavailable(BusError):
    """No server exists, or all servers that were asked left before they answered, or busd ended and the
    request or answer was lost."""

    def __init__(self, service: str, why: str) -> None:
        super().__init__(f"service '{service}' is not available: {why}")
        self.service = service
        """The service's full name."""


class ForkError(BusError, RuntimeError):
    """A node was used after fork() in the child; connections do not survive a fork.

    The child must make a new node; the parent's continues.
    """
