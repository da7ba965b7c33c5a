"""bus.errors: an error raised again is an equal copy, without the first one's traceback."""

import pytest

from bus import errors
from rows import for_each

ERRORS = [
    errors.ConfigurationError("no name", index=3),
    errors.CommandLineError("Couldn't parse remap rule: '-r x'"),
    errors.ParameterError("rate", "parameter 'rate' of /talker: is not declared"),
    errors.PayloadTooLarge("/t", size_bytes=2, limit_bytes=1),
    errors.QuotaExceeded("nodes", used=2, limit=2),
    errors.ConnectionClosed("this publisher on '/t' is closed"),
    errors.ForkError("made before a fork"),
    errors.SharedMemoryError("no memory"),
]


@for_each("error", ERRORS)
def test_again(error: errors.BusError) -> None:
    with pytest.raises(type(error)) as raised:
        raise errors.again(error)
    copy = raised.value
    assert copy is not error
    assert (str(copy), copy.args, vars(copy)) == (str(error), error.args, vars(error))
    assert error.__traceback__ is None
    assert copy.__traceback__ is not None


def test_every_error_is_listed() -> None:
    values = vars(errors).items()
    classes = {name for name, one in values if isinstance(one, type) and issubclass(one, errors.BusError)}
    assert classes == set(errors.__all__) - {"again"}
