"""bus_launch.launch.event_handlers: the events and actions that they handle, and their answers."""

from typing import Any

import pytest

from bus_launch.launch.actions import ExecuteProcess, LogInfo
from bus_launch.launch.core import Event, LaunchContext
from bus_launch.launch.event_handlers import (
    OnExecutionComplete,
    OnIncludeLaunchDescription,
    OnProcessExit,
    OnProcessIO,
    OnProcessStart,
    OnShutdown,
)
from bus_launch.launch.events import ExecutionComplete, IncludeLaunchDescription, Shutdown
from bus_launch.launch.events.process import (
    ProcessExited,
    ProcessIO,
    ProcessStarted,
    ProcessStderr,
    ProcessStdin,
    ProcessStdout,
)
from bus_launch.launch.launch_description import LaunchDescription

FIRST, SECOND = (ExecuteProcess(cmd=[name]) for name in ("first", "second"))
A, B = LogInfo(msg="a"), LogInfo(msg="b")


def details(action: ExecuteProcess) -> dict[str, Any]:
    return {"action": action, "name": "p", "cmd": ["p"], "cwd": None, "env": None}


def events(action: ExecuteProcess) -> list[Event]:
    return [
        ExecutionComplete(action=action),
        ProcessStarted(**details(action)),
        ProcessExited(returncode=0, **details(action)),
        ProcessStdin(text=b"in", **details(action)),
        ProcessStdout(text=b"out", **details(action)),
        ProcessStderr(text=b"err", **details(action)),
    ]


MAKERS: list[tuple[Any, tuple[type[Event], ...]]] = [
    (lambda target: OnExecutionComplete(target_action=target, on_completion=A), (ExecutionComplete,)),
    (lambda target: OnProcessStart(target_action=target, on_start=A), (ProcessStarted,)),
    (lambda target: OnProcessExit(target_action=target, on_exit=A), (ProcessExited,)),
    (lambda target: OnProcessIO(target_action=target), (ProcessStdin, ProcessStdout, ProcessStderr)),
]


@pytest.mark.parametrize(("make", "kinds"), MAKERS)
def test_a_handler_takes_its_kind_of_event_of_its_action_alone(make: Any, kinds: Any) -> None:
    of_one, of_any = make(FIRST), make(None)
    of_some = make(lambda action: action is SECOND)
    for action in (FIRST, SECOND):
        for event in [*events(action), Shutdown(reason="")]:
            is_kind = isinstance(event, kinds)
            assert of_any.matches(event) is is_kind
            assert of_one.matches(event) is (is_kind and action is FIRST)
            assert of_some.matches(event) is (is_kind and action is SECOND)


def test_what_a_handler_answers() -> None:
    context, event = LaunchContext(), events(FIRST)[1]
    assert OnProcessStart(on_start=A).handle(event, context) == [A]
    nested: Any = [A, [B]]
    assert OnProcessStart(on_start=nested).handle(event, context) == [A, B]
    asked: list[Any] = []
    called = OnProcessStart(on_start=lambda *arguments: asked.append(arguments) or B)
    assert called.handle(event, context) is B
    assert asked == [(event, context)]
    assert context.locals.event is event
    with pytest.raises(TypeError, match="expected actions or a function of event and context, got 5"):
        OnProcessStart(on_start=5)  # type: ignore[arg-type]


def test_a_handler_for_one_event_is_unregistered_by_it() -> None:
    context = LaunchContext()
    once, always = OnProcessStart(on_start=A, handle_once=True), OnProcessStart(on_start=A)
    for handler in (once, always):
        context.register_event_handler(handler)
        handler.handle(events(FIRST)[1], context)
    assert context._event_handlers == [always]


def test_output_goes_to_the_function_for_its_stream() -> None:
    found: list[Any] = []
    handler = OnProcessIO(
        on_stdout=lambda event: found.append(("out", event.text)),
        on_stderr=lambda event: found.append(("err", event.text)),
    )
    for event in events(FIRST)[3:]:
        assert handler.handle(event, LaunchContext()) is None
    assert found == [("out", b"out"), ("err", b"err")]


def test_shutdown_and_included_descriptions() -> None:
    context = LaunchContext()
    shutdown, description = Shutdown(reason="enough"), LaunchDescription([A])
    include = IncludeLaunchDescription(description)
    on_shutdown, on_include = OnShutdown(on_shutdown=[A]), OnIncludeLaunchDescription()
    assert [on_shutdown.matches(one) for one in (shutdown, include)] == [True, False]
    assert [on_include.matches(one) for one in (shutdown, include)] == [False, True]
    assert on_shutdown.handle(shutdown, context) == [A]
    assert OnShutdown(on_shutdown=lambda event, _: event.reason).handle(shutdown, context) == "enough"
    assert on_include.handle(include, context) is description


def test_how_handlers_are_described() -> None:
    text, entities = OnProcessExit(target_action=FIRST, on_exit=[A]).describe()
    assert text == ("OnProcessExit(matcher='event == ProcessExited', handler='<actions>', handle_once=False)")
    assert entities == [A]
    assert OnShutdown(on_shutdown=[B]).describe()[1] == [B]


def test_output_is_told_by_its_stream() -> None:
    """Also of an event of the base class, which tests make."""
    found: list[str] = []
    handler = OnProcessIO(
        target_action=lambda action: action is FIRST,
        on_stdin=lambda event: found.append("stdin"),  # type: ignore[arg-type]
        on_stdout=lambda event: found.append("stdout"),  # type: ignore[arg-type]
        on_stderr=lambda event: found.append("stderr"),  # type: ignore[arg-type]
    )
    for number in range(3):
        event = ProcessIO(text=b"", fd=number, **details(FIRST))
        assert handler.matches(event)
        handler.handle(event, LaunchContext())
    assert found == ["stdin", "stdout", "stderr"]


def test_a_target_is_an_action_or_a_function() -> None:
    with pytest.raises(TypeError, match="OnProcessExit requires a 'LaunchDescriptionEntity' instance"):
        OnProcessExit(target_action="first", on_exit=[])  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="expected actions or a function of event and context, got 'stop'"):
        OnProcessExit(on_exit="stop")  # type: ignore[arg-type]
