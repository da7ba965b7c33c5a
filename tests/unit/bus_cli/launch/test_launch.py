"""`bus launch` in this process: the choice of the file, its arguments, and errors in place of a traceback."""

import os
import shlex
from collections.abc import Iterator
from pathlib import Path

import pytest

from bus_cli.main import run
from launching import write
from rows import for_each

ARGUMENTS = """
<launch>
  <arg name="speed" description="in m/s"/>
  <arg name="mode" default="a$(env HOME)"><choice value="a"/><choice value="b"/></arg>
  <group unless="$(var mode)"><arg name="more" default="x"/></group>
</launch>
"""
SHOWN = """\
Arguments (pass arguments as '<name>:=<value>'):

    'speed':
        in m/s

    'mode':
        One of: ['a', 'b']
        (default: 'a' + EnvVar('HOME'))

    'more':*
        no description given
        (default: 'x')

* argument(s) which are only used if specific conditions occur
"""

ROBOT = """
from pathlib import Path
from launch import LaunchDescription
from launch.actions import IncludeLaunchDescription
from launch.substitutions import LaunchConfiguration

def generate_launch_description():
    robot = LaunchConfiguration("robot", default="a")
    return LaunchDescription(
        [IncludeLaunchDescription([str(Path(__file__).parent), "/", robot, ".launch.xml"])]
    )
"""


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A package my_robot, and files. Restores the environment, because a launch changes it."""
    write(
        tmp_path,
        {
            "prefix/share/ament_index/resource_index/packages/my_robot": "",
            "prefix/share/my_robot/launch/all.launch.xml": ARGUMENTS,
            "prefix/share/my_robot/a/two.launch.xml": "<launch/>",
            "prefix/share/my_robot/b/two.launch.xml": "<launch/>",
            "here/mine.launch.xml": '<launch><arg name="x"/><log message="$(var x)"/></launch>',
            "here/bad.launch.py": "def generate_launch_description():\n    return nobody\n",
        },
    )
    before = dict(os.environ)
    monkeypatch.setenv("AMENT_PREFIX_PATH", str(tmp_path / "prefix"))
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path / "log"))
    monkeypatch.chdir(tmp_path / "here")
    yield tmp_path / "here"
    os.environ.clear()
    os.environ.update(before)


def test_arguments_are_listed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["launch", "my_robot", "all.launch.xml", "--show-args"]) == 0
    assert capsys.readouterr().out == SHOWN
    assert run(["launch", "my_robot", "launch/all.launch.xml", "--show-args"]) == 0
    assert capsys.readouterr().out == SHOWN
    assert run(["launch", "my_robot", "../prefix/two.launch.xml", "-s"]) == 1


def test_what_a_file_holds_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["launch", "mine.launch.xml", "--print"]) == 0
    first, second, third = capsys.readouterr().out.splitlines()
    assert first.startswith("<launch.launch_description.LaunchDescription object at 0x")
    assert "DeclareLaunchArgument" in second
    assert third == "└── LogInfo(LaunchConfig('x'))"


def test_a_launch(capsys: pytest.CaptureFixture[str]) -> None:
    from bus_launch.launch import logging

    logging.reset()
    assert run(["launch", "./mine.launch.xml", "x:=1", "x:=a:=b"]) == 0
    assert "[INFO] [launch.user]: a:=b\n" in capsys.readouterr().out
    logging.reset()
    assert run(["launch", "mine.launch.xml", "x:=1", "xx:=2", "of_nobody:=3"]) == 0
    (warning,) = (line for line in capsys.readouterr().out.splitlines() if "WARNING" in line)
    assert warning == "[WARNING] [launch]: the launch file declares no argument 'xx'; did you mean 'x'?"
    logging.reset()
    assert run(["launch", "mine.launch.xml"]) == 1
    assert "missing required argument 'x'" in capsys.readouterr().out
    logging.reset()


def test_an_argument_in_the_path_of_an_include(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    from bus_launch.launch import logging

    files = {f"{name}.launch.xml": f'<launch><log message="{name}"/></launch>' for name in "ab"}
    files["robot.launch.py"] = ROBOT
    write(here, files)
    for words, expected in (("", "a"), ("robot:=b", "b")):
        logging.reset()
        assert run(["launch", "robot.launch.py", *words.split()]) == 0
        assert f"[INFO] [launch.user]: {expected}\n" in capsys.readouterr().out
    logging.reset()


@for_each(
    ("words", "text"),
    [
        ("nosuch.launch.py", "bus launch: 'nosuch.launch.py' does not exist"),
        ("min.launch.xml", "does not exist; did you mean 'mine.launch.xml'?"),
        ("my_robt all.launch.xml", "Package 'my_robt' not found: package 'my_robt' not found, searching: "),
        (
            "my_robot al.launch.xml",
            "'al.launch.xml' was not found in the share directory of package 'my_robot' ",
        ),
        ("my_robot al.launch.xml", "; did you mean 'all.launch.xml'?"),
        (
            "my_robot two.launch.xml",
            "was found more than once in the share directory of package 'my_robot': ['",
        ),
        (
            "my_robot /nosuch/all.launch.xml",
            "file '/nosuch/all.launch.xml' was not found in the share directory",
        ),
        ("my_robot *.launch.xml", "file '*.launch.xml' was not found in the share directory of package"),
        ("my_robot b/all.launch.xml", "file 'b/all.launch.xml' was not found in the share directory of"),
        ("my_robot ''", "file '' was not found in the share directory of package 'my_robot' "),
        ("my_robot", "which launch file of package 'my_robot'? it has: all.launch.xml, two.launch.xml"),
        ("nosuch", "bus launch: 'nosuch' is neither a launch file nor a package"),
        ("mine.launch.xml x=1", "malformed launch argument 'x=1', expected format '<name>:=<value>'"),
        ("mine.launch.xml x:=", "malformed launch argument 'x:=', expected format"),
        ("bad.launch.py -s", "NameError: name 'nobody' is not defined (bad.launch.py, line 2)"),
    ],
)
def test_mistakes(words: str, text: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run(["launch", *shlex.split(words)]) == 1
    err = capsys.readouterr().err
    assert text in err
    assert err.count("\n") == 1
