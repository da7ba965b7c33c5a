"""bus.wire.answers: the requested answer, or an error that names the received message."""

import pytest

from bus.errors import AccessDenied, BusError, ConfigurationError, QuotaExceeded, RemoteProtocolError
from bus.wire import messages as m
from bus.wire.answers import expect
from rows import for_each


def test_what_was_asked_for() -> None:
    answer = m.Done(request=1, text="done")
    assert expect(answer, m.Done) is answer


@for_each(
    ("answer", "error", "text"),
    [
        (m.Refused(request=1, text="no such thing"), ConfigurationError, "^no such thing$"),
        (m.Refused(request=1, text="not you", denied=True), AccessDenied, "^not you$"),
        (
            m.Refused(request=1, text="", resource="nodes of a process", used=3, limit=3),
            QuotaExceeded,
            "^nodes of a process: 3 of 3 in use",
        ),
        (m.Pong(number=1), RemoteProtocolError, "^busd sent Pong instead of Done$"),
    ],
)
def test_anything_else_is_an_error(answer: m.Message, error: type[BusError], text: str) -> None:
    with pytest.raises(error, match=text):
        expect(answer, m.Done)
