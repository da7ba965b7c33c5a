"""busd's own type descriptions, as texts in the files of bags."""

from typing import Any

import msgspec
import pytest

from bus.errors import ConfigurationError
from bus.msg.sensor_msgs import Imu
from bus.schema import MessageSchema
from bus_bag.schemas import schema_from_text, schema_to_text


class Own(msgspec.Struct):
    names: dict[str, int | None]
    flag: bool | str = True


@pytest.mark.parametrize("message_type", [Imu, Own])
def test_there_and_back(message_type: Any) -> None:
    schema = MessageSchema.of(message_type)
    text = schema_to_text(schema)
    assert text.isascii() and text.isprintable()
    assert schema_from_text(text) == schema


@pytest.mark.parametrize("text", ["", "ö", "no base64!", "AAAA", "gaRyb290"])
def test_what_is_no_description(text: str) -> None:
    with pytest.raises(ConfigurationError):
        schema_from_text(text)
