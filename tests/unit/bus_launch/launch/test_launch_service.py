"""Running descriptions, without processes: order, scopes, events, files, and errors."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

from bus_launch.launch import LaunchService, logging
from bus_launch.launch.action import Action
from bus_launch.launch.actions import (
    AppendEnvironmentVariable,
    DeclareLaunchArgument,
    EmitEvent,
    GroupAction,
    IncludeLaunchDescription,
    LogInfo,
    OpaqueCoroutine,
    OpaqueFunction,
    PopLaunchConfigurations,
    PushLaunchConfigurations,
    RegisterEventHandler,
    SetEnvironmentVariable,
    SetLaunchConfiguration,
    Shutdown,
    TimerAction,
    UnregisterEventHandler,
    UnsetEnvironmentVariable,
    UnsetLaunchConfiguration,
)
from bus_launch.launch.actions.basic import seconds
from bus_launch.launch.conditions import IfCondition, UnlessCondition
from bus_launch.launch.core import (
    Event,
    EventHandler,
    LaunchContext,
    LaunchDescriptionEntity,
    Substitution,
    TextSubstitution,
)
from bus_launch.launch.event_handlers import OnExecutionComplete, OnShutdown
from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch.launch_description_sources import (
    AnyLaunchDescriptionSource,
    LaunchDescriptionSource,
    PythonLaunchDescriptionSource,
    get_launch_description_from_any_launch_file,
)
from bus_launch.launch.substitutions import LaunchConfiguration, ThisLaunchFileDir
from launching import note, run, said, write
from rows import for_each

A = LaunchConfiguration("a", default="none")
IS_OFF = LaunchConfiguration("is_off")
A_TEXT: Any = ["a"]
FIVE: Any = 5
PRINT: Any = print


@pytest.fixture(autouse=True)
def logs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))


def test_actions_come_in_their_order(capsys: pytest.CaptureFixture[str]) -> None:
    code = run(
        SetLaunchConfiguration("a", "1"),
        LogInfo(msg=["a is ", A]),
        LogInfo(msg="never", condition=UnlessCondition(A)),
        LogInfo(msg="yes", condition=IfCondition(A)),
        OpaqueFunction(function=lambda context: [LogInfo(msg=["returned: ", A])]),
        UnsetLaunchConfiguration("a"),
        LogInfo(msg=A),
    )
    assert said(capsys.readouterr().out) == ["a is 1", "yes", "returned: 1", "none"]
    assert code == 0


def test_what_a_group_sets_ends_with_it(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OF_A_TEST", "before")
    found: list[Any] = []
    look = [note(found, "a"), note(found, lambda _: os.environ.get("OF_A_TEST"))]
    code = run(
        SetLaunchConfiguration("a", "1"),
        GroupAction(
            [
                SetLaunchConfiguration("a", "2"),
                SetEnvironmentVariable("OF_A_TEST", "inside"),
                AppendEnvironmentVariable("OF_A_TEST", "x", prepend=True),
                *look,
            ]
        ),
        *look,
        GroupAction([SetLaunchConfiguration("a", "3"), UnsetEnvironmentVariable("OF_A_TEST")], scoped=False),
        *look,
        GroupAction([note(found, "a"), note(found, "b")], forwarding=False, launch_configurations={"b": "4"}),
        PushLaunchConfigurations(),
        SetLaunchConfiguration("a", "5"),
        PopLaunchConfigurations(),
        note(found, "a"),
    )
    assert code == 0
    assert found == ["2", "x:inside", "1", "before", "3", None, None, "4", "3"]


def test_a_group_without_forwarding_has_the_environment_of_the_beginning(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setenv("OF_A_TEST", "at the beginning")
    found: list[Any] = []
    look = note(found, lambda _: os.environ.get("OF_A_TEST"))
    group = GroupAction([look], forwarding=False)
    assert run(SetEnvironmentVariable("OF_A_TEST", "set"), group, look) == 0
    assert found == ["at the beginning", "set"]


def test_events_and_handlers() -> None:
    """The newest handler is asked first. A handler may be for one event only."""
    found: list[Any] = []

    class Mine(Event):
        def __init__(self, number: int) -> None:
            self.number = number

    def handler(name: str, **kwargs: Any) -> EventHandler:
        return EventHandler(
            matcher=lambda event: isinstance(event, Mine),
            entities=note(found, lambda context: (name, context.locals.event.number)),
            **kwargs,
        )

    first, second = handler("first"), handler("second")
    code = run(
        *(RegisterEventHandler(one) for one in (first, second, handler("once", handle_once=True))),
        EmitEvent(event=Mine(1)),
        RegisterEventHandler(
            OnExecutionComplete(
                target_action=lambda action: isinstance(action, TimerAction),
                on_completion=[UnregisterEventHandler(second), EmitEvent(event=Mine(2))],
            )
        ),
        TimerAction(period=0.01, actions=[note(found, lambda _: "timer")]),
    )
    assert code == 0
    assert found == [("once", 1), ("second", 1), ("first", 1), "timer", ("first", 2)]


def test_shutdown_ends_what_waits() -> None:
    found: list[Any] = []

    async def wait(context: LaunchContext) -> None:
        try:
            assert context.asyncio_loop is not None
            await context.asyncio_loop.create_future()
        finally:
            found.append("cancelled")

    code = run(
        TimerAction(period=1000.0, actions=[note(found, lambda _: "never")]),
        OpaqueCoroutine(coroutine=wait),
        RegisterEventHandler(OnShutdown(on_shutdown=lambda event, _: found.append(event.reason))),
        TimerAction(period="0.01", actions=[Shutdown(reason="enough")]),
    )
    assert code == 0
    assert sorted(found) == ["cancelled", "enough"]


@for_each(
    ("is_cancelled", "expected"),
    [(True, []), (False, ["late"]), ("false", ["late"]), (IS_OFF, ["late"]), (["tr", "ue"], [])],
)
def test_a_timer_that_shutdown_begins(is_cancelled: Any, expected: list[str]) -> None:
    found: list[Any] = []
    timer = TimerAction(period=0.01, actions=[note(found, lambda _: "late")], cancel_on_shutdown=is_cancelled)
    assert (
        run(SetLaunchConfiguration("is_off", "0"), RegisterEventHandler(OnShutdown(on_shutdown=[timer]))) == 0
    )
    assert found == expected


def test_a_timer_with_no_period_visits_its_actions_at_once() -> None:
    found: list[Any] = []
    assert run(*(TimerAction(period=one, actions=[note(found, "a")]) for one in (0, 0.0, "0"))) == 0
    assert found == [None] * 3


def test_a_timer_keeps_what_its_place_sees(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The folder of its file, and the event that an outer handler is for."""

    class Mine(Event):
        number = 5

    late = '<timer period="0"><log message="$(dirname)"/></timer>'
    inner = f"<launch>{late.replace('timer', 'ros_timer')}</launch>"
    outer = f'<launch>{late}<include file="$(dirname)/sub/inner.launch.xml"/></launch>'
    write(tmp_path, {"outer.launch.xml": outer, "sub/inner.launch.xml": inner})
    found: list[Any] = []
    timer = TimerAction(period=0, actions=[note(found, lambda context: context.locals.event.number)])
    handler = EventHandler(matcher=lambda event: isinstance(event, Mine), entities=timer)
    include = IncludeLaunchDescription(str(tmp_path / "outer.launch.xml"))
    assert run(RegisterEventHandler(handler), EmitEvent(event=Mine()), include) == 0
    assert found == [5]
    assert said(capsys.readouterr().out) == [str(tmp_path), str(tmp_path / "sub")]


@for_each("text", ["inf", "nan", "-0.1", ""])
def test_what_is_no_period(text: str) -> None:
    with pytest.raises(ValueError, match=f"a period must be a number of seconds, not '{text}'"):
        seconds(LaunchContext(), [TextSubstitution(text=text)])


def test_nobody_has_read_stdout_before_the_launch_began(monkeypatch: pytest.MonkeyPatch) -> None:
    """As with `bus launch ... | head -1`: the launch ends, and does not wait for its timer."""
    # Closed after the reset with which `run` begins.
    monkeypatch.setattr(logging, "reset", lambda: setattr(logging.launch_config, "is_screen_closed", True))
    assert run(TimerAction(period=1000.0, actions=[])) == 0
    monkeypatch.undo()
    logging.reset()


def test_actions_and_substitutions_of_users(capsys: pytest.CaptureFixture[str]) -> None:
    class Upper(Substitution):
        def __init__(self, sub: Substitution) -> None:
            super().__init__()
            self.sub = sub

        def perform(self, context: LaunchContext) -> str:
            return context.perform_substitution(self.sub).upper()

    class Twice(Action):
        def __init__(self, entity: LaunchDescriptionEntity, **kwargs: Any) -> None:
            super().__init__(**kwargs)
            self.entity = entity

        def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity]:
            return [self.entity, self.entity]

    run(SetLaunchConfiguration("a", "x"), Twice(LogInfo(msg=Upper(A)), condition=IfCondition("true")))
    assert said(capsys.readouterr().out) == ["X", "X"]


PART = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, LogInfo
from launch.substitutions import LaunchConfiguration, ThisLaunchFileDir

def generate_launch_description():
    return LaunchDescription([
        DeclareLaunchArgument("name", description="a name"),
        DeclareLaunchArgument("greeting", default_value=["hi ", LaunchConfiguration("name")]),
        LogInfo(msg=[LaunchConfiguration("greeting"), " from ", ThisLaunchFileDir()]),
    ])
"""


def test_an_included_file_leaves_the_folder_of_the_file_as_it_was(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = '<log message="$(dirname)"/>'
    files = {
        "sub/inner.launch.xml": f"<launch>{log}</launch>",
        "outer.launch.xml": f'<launch>{log}<include file="$(dirname)/sub/inner.launch.xml"/>{log}</launch>',
    }
    write(tmp_path, files)
    assert run(IncludeLaunchDescription(str(tmp_path / "outer.launch.xml"))) == 0
    assert said(capsys.readouterr().out) == [str(tmp_path), str(tmp_path / "sub"), str(tmp_path)]


def test_after_an_include_a_script_has_no_file(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, {"a.launch.xml": "<launch/>"})
    include = IncludeLaunchDescription(str(tmp_path / "a.launch.xml"))
    assert run(include, LogInfo(msg=ThisLaunchFileDir())) == 1
    assert "ThisLaunchFileDir used outside of a launch file" in capsys.readouterr().out


def test_an_argument_that_an_included_file_needs(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(tmp_path, {"a.launch.xml": '<launch><arg name="x" description="an x"/><arg name="y"/></launch>'})
    assert run(IncludeLaunchDescription(str(tmp_path / "a.launch.xml"), launch_arguments=[("y", "1")])) == 1
    assert (
        "Included launch description missing required argument 'x' (description: 'an x'), given: [y]"
        in capsys.readouterr().out
    )


def test_files_include_files(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write(
        tmp_path,
        {
            "sub/part.launch.py": PART,
            "part.launch.xml": '<launch><arg name="x"/><log message="$(var x) $(dirname)"/></launch>',
            "part.launch.yaml": "launch: [{include: {file: $(dirname)/part.launch.xml}}]",
        },
    )
    code = run(
        IncludeLaunchDescription(
            PythonLaunchDescriptionSource([str(tmp_path), "/sub/part.launch.py"]),
            launch_arguments={"name": "Ann"}.items(),
        ),
        IncludeLaunchDescription(str(tmp_path / "part.launch.yaml"), launch_arguments=[("x", A)]),
        LogInfo(msg=[LaunchConfiguration("name"), LaunchConfiguration("x")]),
    )
    assert code == 0
    assert said(capsys.readouterr().out) == [f"hi Ann from {tmp_path}/sub", f"none {tmp_path}", "Annnone"]


def test_an_argument_of_an_include_can_use_an_earlier_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = '<log message="$(var x) $(var y)"/>'
    arguments = '<arg name="x" value="1"/><arg name="y" value="$(var x)2"/>'
    files = {
        "in.launch.xml": f'<launch><arg name="x"/><arg name="y"/>{log}</launch>',
        "out.launch.xml": f'<launch><include file="$(dirname)/in.launch.xml">{arguments}</include></launch>',
    }
    write(tmp_path, files)
    assert run(IncludeLaunchDescription(str(tmp_path / "out.launch.xml"))) == 0
    assert said(capsys.readouterr().out) == ["1 12"]


def test_a_path_that_depends_on_an_argument(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The arguments are inspected before the launch, when the path has its default."""
    write(tmp_path, {f"{name}.launch.xml": f'<launch><log message="{name}"/></launch>' for name in "ab"})
    robot = LaunchConfiguration("robot", default="a")
    source = AnyLaunchDescriptionSource([str(tmp_path), "/", robot, ".launch.xml"])
    description = LaunchDescription([IncludeLaunchDescription(source)])
    description.get_launch_arguments()
    assert source.location == f"{tmp_path}/a.launch.xml"
    assert run(SetLaunchConfiguration("robot", "b"), description) == 0
    assert source.location == f"{tmp_path}/b.launch.xml"
    assert said(capsys.readouterr().out) == ["b"]


def test_a_file_is_read_once_for_an_inspection_and_a_launch(tmp_path: Path) -> None:
    write(tmp_path, {"a.launch.xml": "<launch/>"})
    source = AnyLaunchDescriptionSource(str(tmp_path / "a.launch.xml"))
    inspected = source.try_get_launch_description_without_context()
    assert inspected is not None
    assert source.get_launch_description(LaunchContext()) is inspected
    given = LaunchDescription()
    assert LaunchDescriptionSource(given).get_launch_description(LaunchContext()) is given


def test_the_arguments_of_a_file_and_of_those_that_it_includes(tmp_path: Path) -> None:
    write(
        tmp_path,
        {
            "part.launch.py": PART,
            "all.launch.xml": f"""
                <launch>
                  <arg name="a" default="$(env HOME)" description="an a"/>
                  <group if="$(var a)"><arg name="maybe"/></group>
                  <include file="{tmp_path}/part.launch.py"><arg name="name" value="x"/></include>
                  <include file="{tmp_path}/all.launch.xml"/>
                </launch>""",
        },
    )
    found = get_launch_description_from_any_launch_file(
        str(tmp_path / "all.launch.xml")
    ).get_launch_arguments()
    assert [(one.name, one.description, one._conditionally_included) for one in found] == [
        ("a", "an a", False),
        ("greeting", "no description given", False),
        ("maybe", "no description given", True),
    ]


@for_each(
    ("entity", "text"),
    [
        (LogInfo(msg=LaunchConfiguration("x")), "launch configuration 'x' does not exist"),
        (
            DeclareLaunchArgument("x", description="an x"),
            'Required launch argument "x" (description: "an x") was not provided',
        ),
        (
            GroupAction([SetLaunchConfiguration("x", "c"), DeclareLaunchArgument("x", choices=["a", "b"])]),
            "Argument \"x\" provided value \"c\" is not valid. Valid options are: ['a', 'b']",
        ),
        (
            LogInfo(msg="", condition=IfCondition("maybe")),
            "Expression 'maybe' is not one of the valid true expressions ['true', '1'] or false expressions "
            "['false', '0']",
        ),
        (TimerAction(period="soon", actions=[]), "a period must be a number of seconds, not 'soon'"),
        (PopLaunchConfigurations(), "launch_configurations stack unexpectedly empty"),
        (OpaqueFunction(function=lambda _: [][1]), "list index out of range"),
        (IncludeLaunchDescription("/nosuchfile.py"), "[Errno 2] No such file or directory: '/nosuchfile.py'"),
    ],
)
def test_an_error_ends_the_launch(
    entity: LaunchDescriptionEntity, text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run(entity, TimerAction(period=1000.0, actions=[])) == 1
    line = f"[ERROR] [launch]: Caught exception in launch (see debug for traceback): {text}\n"
    assert capsys.readouterr().out == line


def test_a_file_that_includes_itself(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = tmp_path / "again.launch.xml"
    file.write_text('<launch><include file="$(dirname)/again.launch.xml"/></launch>')
    assert run(IncludeLaunchDescription(AnyLaunchDescriptionSource(str(file)))) == 1
    assert f"does '{file}' include itself?" in capsys.readouterr().out


@for_each(
    ("make", "text"),
    [
        (lambda: LaunchDescription(A_TEXT), "a launch description is made of actions, not of 'a'"),
        (lambda: LogInfo(msg=FIVE), "Failed to normalize given item of type '<class 'int'>'"),
        (lambda: EmitEvent(event=A_TEXT[0]), "expected an event instance, got 'a'"),
        (lambda: OpaqueFunction(function=FIVE), "expected a function, got 5"),
        (lambda: OpaqueCoroutine(coroutine=PRINT), "expected a coroutine function"),
        (lambda: DeclareLaunchArgument("x", choices=[]), "Provided choices arg is empty"),
        (lambda: DeclareLaunchArgument("x", default_value="c", choices=["a"]), 'default_value "c" is not in'),
        (lambda: IncludeLaunchDescription("x", launch_arguments=A_TEXT), "pairs of name and value, not 'a'"),
        (
            lambda: OnExecutionComplete(target_action=FIVE, on_completion=[]),
            "instance or a callable as target",
        ),
    ],
)
def test_what_can_not_be_made(make: Any, text: str) -> None:
    with pytest.raises((TypeError, ValueError, RuntimeError)) as caught:
        make()
    assert text in str(caught.value)


def test_a_service_runs_again(capsys: pytest.CaptureFixture[str]) -> None:
    """An event between two runs waits for the second, in another event loop."""
    service = LaunchService()
    service.include_launch_description(LaunchDescription([LogInfo(msg="one")]))
    assert service.run() == 0
    service.include_launch_description(LaunchDescription([LogInfo(msg="two")]))
    assert service.run() == 0
    assert said(capsys.readouterr().out) == ["one", "two"]


def test_entities_without_work_of_their_own() -> None:
    assert run(Action(), LaunchDescriptionEntity()) == 0


def test_environment_variables_grow_at_both_ends() -> None:
    context = LaunchContext()
    context.environment["A"] = "a"
    for prepend in (True, "yes", "False", ["t", "rue"]):
        action = AppendEnvironmentVariable("A", "b", prepend=prepend, separator="-")
        action.execute(context)
    assert context.environment["A"] == "b-b-b-a-b"
    assert AppendEnvironmentVariable("A", "b", prepend=True).prepend is True


def test_locals_can_not_be_set() -> None:
    context = LaunchContext()
    context.extend_locals({"a": 1})
    with pytest.raises(AttributeError, match=r"use context.extend_locals for 'a'"):
        context.locals.a = 2
    assert context.locals.a == 1


def test_from_another_thread(capsys: pytest.CaptureFixture[str]) -> None:
    from threading import Thread

    service = LaunchService()
    entered: list[Thread] = []

    def begin(context: LaunchContext) -> None:
        def end() -> None:
            service.include_launch_description(LaunchDescription([LogInfo(msg="late")]))
            service.shutdown()

        entered.append(Thread(target=end))
        entered[0].start()

    run(
        OpaqueFunction(function=begin),
        TimerAction(period=1000.0, actions=[]),
        LogInfo(msg=ThisLaunchFileDir(), condition=UnlessCondition("true")),
        service=service,
    )
    entered[0].join()
    assert "[INFO] [launch.user]: late" in capsys.readouterr().out
