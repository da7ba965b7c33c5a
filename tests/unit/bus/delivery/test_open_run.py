"""bus.delivery.open_run: the tasks of `publish`, and the tasks that it leaves to its callers. See also
test_runs_native.py.
"""

import gc
import sys
import threading
import weakref
from collections.abc import Callable
from typing import Any

import pytest

from bus import shm
from bus.delivery.open_run import OpenRun, PythonRun, open_run
from bus.msg.std_msgs import String
from bus.shm import has_core
from bus.types.support import type_support
from bus.wire.layout import DATA_HEAD_BYTES, RECORD_HEAD_BYTES
from bus.wire.runs import Run

SUPPORT = type_support(String)


class Route:
    """Begins runs, as a publisher's route does. Each run has room for `budget` more bytes."""

    make: Callable[[], OpenRun] = PythonRun

    def __init__(self, budget: int = 0) -> None:
        self.run: OpenRun = Route.make()
        self.budget = budget
        self.stamps: list[int] = []
        self.act: Callable[[], object] = int
        self.asked: list[int] = []
        self.ask: Callable[[], bool] = lambda: True
        self.run.begins_below = 100

    def prepare(self, encode: Callable[[Any], bytes] | None = None) -> OpenRun:
        """Prepare the run. With its own encoder, it has no plan that would replace the encoder."""
        self.run.begin_by(self.begun, self.may_begin)
        if encode is None:
            self.run.prepare(*SUPPORT.steps)
        else:
            self.run.prepare(SUPPORT.cls, SUPPORT.is_valid, encode, None)
        return self.run

    def may_begin(self, size: int) -> bool:
        self.asked.append(size)
        return self.ask()

    def begun(self, stamp_ns: int) -> None:
        self.stamps.append(stamp_ns)
        self.run.budget = self.budget
        self.act()


def payload_bytes(run: OpenRun) -> list[bytes]:
    """End the run and return its payloads."""
    count = run.samples
    body = memoryview(run.end(1, 1, 0))[DATA_HEAD_BYTES:]
    return [bytes(payload) for payload, _ in Run(0, 0, 1, count, body).records()]


def payloads(run: OpenRun) -> list[str]:
    return [SUPPORT.decode(payload).data for payload in payload_bytes(run)]


def native_run() -> OpenRun:
    return shm.native.OpenRun()


natively = pytest.mark.skipif(not has_core(), reason="the native core was not built")


@pytest.fixture(params=["python", pytest.param("native", marks=natively)])
def made(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> None:
    """Parameter: runs in Python, or runs of the native core."""
    monkeypatch.setattr(Route, "make", PythonRun if request.param == "python" else native_run)


def test_without_the_core_it_is_in_python(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("BUS_NATIVE", "no")
    assert isinstance(open_run(), PythonRun)


def test_what_its_owner_changes_later_was_taken_as_it_was() -> None:
    run, payload = PythonRun(), bytearray(b"one")
    run.begin(payload, 1)
    run.budget = 1000
    payload[:] = b"two"
    assert run.add(payload)
    payload[:] = b"six"
    assert payload_bytes(run) == [b"one", b"two"]


@pytest.mark.usefixtures("made")
class TestPublish:
    def test_a_run_is_begun_and_told_of_once(self) -> None:
        route = Route(budget=1000)
        run = route.prepare()
        assert [run.publish(String(data=text)) for text in "abc"] == [True, True, True]
        assert len(route.stamps) == 1
        assert payloads(run) == ["a", "b", "c"]

    def test_what_has_no_room_comes_back_encoded(self) -> None:
        route = Route(budget=RECORD_HEAD_BYTES + 2)
        run = route.prepare()
        assert run.publish(String(data="a"))
        assert run.publish(String(data="bc")) == SUPPORT.encode(String(data="bc"))
        assert run.publish(String(data=""))
        assert run.publish(String(data="")) == SUPPORT.encode(String(data=""))
        assert payloads(run) == ["a", ""]

    def test_a_full_run_takes_no_more(self) -> None:
        route = Route(budget=1000)
        run = route.prepare()
        run.most = 2
        assert [run.publish(String(data="a")) is True for _ in range(3)] == [True, True, False]

    @pytest.mark.parametrize("size", [98, 200])
    def test_a_long_one_begins_none(self, size: int) -> None:
        route = Route()
        run = route.prepare()
        message = String(data="a" * size)
        assert run.publish(message) == SUPPORT.encode(message)
        assert (run.samples, route.stamps) == (0, [])

    def test_what_it_does_not_know_is_left_alone(self) -> None:
        class Other(String):
            pass

        route = Route()
        assert route.run.publish(String()) is False  # the run is not prepared yet
        run = route.prepare()
        wrong: Any = 5
        for message in (None, "text", String, Other(), String(data=wrong), String(data="\ud800")):
            assert run.publish(message) is False
        assert (run.samples, route.stamps) == (0, [])

    def test_only_its_thread_publishes_or_whose_it_is_now(self) -> None:
        route = Route(budget=1000)
        run = route.prepare()
        answers: list[Any] = []

        def publish() -> None:
            answers.append(run.publish(String(data="a")))
            answers.append(run.add(b"", 1))

        for run.is_mine in (None, lambda: True, lambda: False):
            thread = threading.Thread(target=publish)
            thread.start()
            thread.join()
        assert answers == [False, False, True, True, False, False]

    def test_an_interruption_goes_through(self) -> None:
        def encode(message: String) -> bytes:
            raise KeyboardInterrupt

        run = Route().prepare(encode)
        with pytest.raises(KeyboardInterrupt):
            run.publish(String())
        assert run.samples == 0

    def test_what_the_route_raises_goes_through_and_the_sample_is_there(self) -> None:
        route = Route()

        def fail() -> None:
            raise MemoryError

        route.act = fail
        run = route.prepare()
        with pytest.raises(MemoryError):
            run.publish(String(data="a"))
        assert payloads(run) == ["a"]

    def test_an_encoder_may_publish_itself(self) -> None:
        route = Route(budget=1000)

        def encode(message: String) -> bytes:
            if message.data == "outer":
                assert run.publish(String(data="inner"))
            return SUPPORT.encode(message)

        run = route.prepare(encode)
        assert run.publish(String(data="outer"))
        assert payloads(run) == ["inner", "outer"]

    def test_an_encoder_may_end_the_run(self) -> None:
        route = Route(budget=1000)
        frames: list[Any] = []

        def encode(message: String) -> bytes:
            if run.samples:
                frames.append(run.end(1, 1, 0))
                run.begins_below = 0
            return SUPPORT.encode(message)

        run = route.prepare(encode)
        assert run.publish(String(data="a"))
        assert run.publish(String(data="b")) == SUPPORT.encode(String(data="b"))
        assert (len(frames), run.samples) == (1, 0)

    def test_the_route_may_end_the_run_while_it_is_told(self) -> None:
        route = Route()
        frames: list[Any] = []
        run = route.prepare()
        route.act = lambda: frames.append(run.end(1, 1, 0))
        assert run.publish(String(data="a")) and run.publish(String(data="b"))
        assert (len(frames), run.samples) == (2, 0)

    def test_an_encoding_that_is_no_bytes_is_left_to_others(self) -> None:
        wrong: Any = bytearray
        run = Route().prepare(lambda message: wrong(b"a"))
        assert run.publish(String()) is False

    def test_a_route_and_its_run_go_together(self) -> None:
        route = Route()
        route.prepare()
        gone = weakref.ref(route)
        del route
        gc.collect()
        assert gone() is None

    def test_what_is_encoded_is_taken_likewise(self) -> None:
        route = Route(budget=1000)
        run = route.prepare()
        assert [run.write(part) for part in (b"a", bytearray(b"b"), memoryview(b"c"))] == [True] * 3
        assert (len(route.stamps), payload_bytes(run)) == (1, [b"a", b"b", b"c"])
        assert run.write(b"a" * 100) is False
        with pytest.raises(TypeError):
            run.write("a")  # type: ignore[arg-type]
        assert run.samples == 0

    def test_the_route_is_asked_before_a_run_is_begun(self) -> None:
        route = Route(budget=1000)
        run = route.prepare()
        message = String(data="a")
        route.ask = lambda: False
        assert (run.publish(message), run.write(b"a")) == (SUPPORT.encode(message), False)
        route.ask = lambda: True
        assert run.publish(message) is True and run.publish(message) is True
        assert (route.asked, len(route.stamps)) == ([len(SUPPORT.encode(message)), 1, 3], 1)
        assert payloads(run) == ["a", "a"]

    def test_the_route_may_fail_or_publish_when_it_is_asked(self) -> None:
        route = Route(budget=1000)
        run = route.prepare()

        def fail() -> bool:
            raise KeyboardInterrupt

        def nest() -> bool:
            route.ask = lambda: True
            return run.publish(String(data="inner")) is True

        route.ask = fail
        with pytest.raises(KeyboardInterrupt):
            run.publish(String(data="a"))
        route.ask = nest
        assert run.publish(String(data="outer")) is True
        assert (len(route.stamps), payloads(run)) == (1, ["inner", "outer"])

    def test_a_publisher_prepares_it_once(self) -> None:
        route = Route()
        route.prepare()
        with pytest.raises(ValueError, match="ways already"):
            route.prepare()
        with pytest.raises(ValueError, match="prepared already"):
            route.run.prepare(*SUPPORT.steps)


@natively
def test_numbers_that_the_wire_has_no_place_for_are_refused() -> None:
    run = native_run()
    with pytest.raises(ValueError, match="no run is open"):
        run.end(1, 1, 0)
    run.begin(b"", 1)
    with pytest.raises(ValueError, match="too large"):
        run.end(1 << 32, 1, 0)
    with pytest.raises(OverflowError):
        run.end(1, -1, 0)
    with pytest.raises(ValueError, match="a run is open"):
        run.begin(b"", 1)
    with pytest.raises(TypeError):
        run.add(5)  # type: ignore[arg-type]
    assert run.samples == 1


@pytest.mark.skipif(sys.version_info < (3, 12), reason="no buffer is got by Python code")
def test_a_run_that_its_payload_begins_is_not_begun_again() -> None:
    class Payload:
        def __buffer__(self, flags: int) -> memoryview:
            run.begin(b"first", 1)
            return memoryview(b"second")

    payload: Any = Payload()
    run: OpenRun = shm.native.OpenRun()
    with pytest.raises(ValueError, match="a run is open"):
        run.begin(payload, 2)
    assert (run.samples, run.budget) == (1, 0)
