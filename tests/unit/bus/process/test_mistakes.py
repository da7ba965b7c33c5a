"""Wrong calls by users of other libraries, and the one line that each call prints."""

import array
import asyncio
import dataclasses
import re
from typing import Any

import msgspec
import pytest

import bus
from bus.errors import BusError, LocalProtocolError, PayloadTooLarge
from bus.msg.std_msgs import String
from bus.process import mistakes
from bus.process.waiters import Waiters
from bus.qos import profile
from bus.srv.std_srvs import SetBool
from bus.timer import Timer
from bus.types.support import type_support
from rows import for_each


@dataclasses.dataclass
class Pose:
    x: float


class Frame(msgspec.Struct):
    pixels: list[array.array]  # type: ignore[type-arg]


@for_each(
    ("given", "text"),
    [
        (Pose, "Pose is no message class, but a dataclass: derive it from msgspec.Struct"),
        ("std_msgs/msg/String", "is no message class: give the class itself, as bus.msg.std_msgs.String"),
        (String(), "is no message class: give its class, String"),
        (SetBool, "is no message class, but a service: create_service and create_client take it"),
        (int, "builtins.int is no message class: one is derived from msgspec.Struct"),
        (3, "3 is no message class: one is derived from msgspec.Struct"),
        (Frame, "local/msg/Frame: field 'pixels' is a array.array, which no subscription can decode"),
    ],
)
def test_what_is_no_message_class(given: Any, text: str) -> None:
    with pytest.raises(bus.MessageTypeError, match=re.escape(text)) as raised:
        type_support(given)
    assert "\n" not in str(raised.value)


def test_a_scalar_of_numpy_is_no_picture() -> None:
    generic = type("generic", (), {"__module__": "numpy"})
    scalar = type("float32", (generic,), {"__module__": "numpy"})
    assert str(mistakes.array_field("a/msg/A", "x", scalar)).endswith(
        "is a numpy.float32, which no subscription can decode: declare it as int or float, or as one of "
        "bus.msg's (uint8, float32, ...)"
    )


def test_arguments_in_another_order() -> None:
    with pytest.raises(bus.ConfigurationError, match=r"create_subscription\(type, topic, QoS, callback\)"):
        profile(print)  # type: ignore[arg-type]
    with pytest.raises(
        bus.ConfigurationError, match=r"the period comes first: create_timer\(0.5, callback\)"
    ):
        Timer(print, 0.5, print, None)  # type: ignore[arg-type]
    with pytest.raises(bus.ConfigurationError, match="topic name must be a string, not the class String"):
        bus.Node("n", arguments=()).resolve_topic_name(String)  # type: ignore[arg-type]


def test_run_is_given_the_function() -> None:
    async def main() -> None: ...

    with pytest.raises(TypeError, match=r"write bus\.run\(main\(\)\), not bus\.run\(main\)"):
        bus.run(main)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match=r"as in bus\.run\(main\(\)\), not None"):
        bus.run(None)  # type: ignore[arg-type]


async def test_run_inside_of_a_loop_leaves_no_coroutine_behind(recwarn: pytest.WarningsRecorder) -> None:
    async def main() -> None: ...

    with pytest.raises(RuntimeError, match="write await main"):
        bus.run(main())
    assert not recwarn.list


def test_a_node_without_a_loop() -> None:
    opening = bus.Node("n", arguments=()).open()
    with pytest.raises(LocalProtocolError, match=r"open it in async def main\(\): bus\.run\(main\(\)\)"):
        opening.send(None)


def test_a_node_under_trio(monkeypatch: pytest.MonkeyPatch) -> None:
    class Trio:
        class lowlevel:
            @staticmethod
            def in_trio_run() -> bool:
                return True

    monkeypatch.setitem(mistakes.sys.modules, "trio", Trio)  # type: ignore[attr-defined]
    assert "trio.to_thread.run_sync(lambda: bus.run(main()))" in str(mistakes.wrong_open("/n", is_open=False))


def test_what_belongs_to_another_loop() -> None:
    async def make() -> Waiters:
        return Waiters(asyncio.get_running_loop())

    async def wait(waiters: Waiters) -> None:
        with pytest.raises(LocalProtocolError, match="belongs to an event loop that has ended"):
            await waiters.wait()
        assert not waiters

    asyncio.run(wait(asyncio.run(make())))
    with asyncio.Runner() as runner:
        error: BusError = mistakes.other_loop("node /n", runner.get_loop())
    assert "run_coroutine_threadsafe" in str(error)


def test_a_message_that_is_too_large_names_the_keys() -> None:
    text = str(PayloadTooLarge("/t", size_bytes=20, limit_bytes=10))
    assert text == (
        "message on '/t' has 20 bytes, the limit is 10; in busd.toml it is message_bytes of [limits], or "
        "max_message_bytes of a rule in [[topics]]"
    )
