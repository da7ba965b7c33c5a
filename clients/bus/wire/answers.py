"""Checks an answer of busd: returns a message of the expected kind, or raises an error."""

from typing import Any, TypeVar

from bus.errors import AccessDenied, BusError, ConfigurationError, QuotaExceeded, RemoteProtocolError
from bus.wire.messages import Message, Refused

__all__ = ["RefusedForNow", "expect"]

M = TypeVar("M", bound=Message)


class RefusedForNow(ConfigurationError):
    """A refusal with a temporary reason, for example another endpoint that may end. A retry may succeed."""


def expect(answer: Any, kind: type[M]) -> M:
    """Check that `answer` is a `kind`, and return it.

    Raises ConfigurationError, QuotaExceeded or AccessDenied if it is Refused, else RemoteProtocolError.
    """
    if isinstance(answer, kind):
        return answer
    if isinstance(answer, Refused):
        raise _refusal(answer)
    raise RemoteProtocolError(f"busd sent {type(answer).__name__} instead of {kind.__name__}")


def _refusal(answer: Refused) -> BusError:
    if answer.resource:
        return QuotaExceeded(answer.resource, used=answer.used, limit=answer.limit)
    if answer.denied:
        return AccessDenied(answer.text)
    return RefusedForNow(answer.text) if answer.again else ConfigurationError(answer.text)
