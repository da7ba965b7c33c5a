"""`bus run PKG EXE` of packages for CMake: their Python programs run from the source, without a build."""

from collections.abc import Callable
from pathlib import Path

import pytest

from packaged import Result, run_bus, sources

Run = Callable[..., Result]
MANIFEST = "<package format='3'><name>arm</name><version>1.2.3</version></package>"

CMAKE = """\
cmake_minimum_required(VERSION 3.8)
project(arm)
find_package(ament_cmake REQUIRED)
add_executable(driver src/driver.cpp)
install(TARGETS driver DESTINATION lib/${PROJECT_NAME})
ament_python_install_package(${PROJECT_NAME})
install(PROGRAMS
  scripts/show.py
  scripts/gone.py
  scripts/plain
  DESTINATION lib/${PROJECT_NAME}
)
install(PROGRAMS scripts/show.py DESTINATION lib/${PROJECT_NAME} RENAME show)
rosidl_generate_interfaces(${PROJECT_NAME} "msg/Grip.msg")
ament_package()
"""
SHOW = """\
import sys
from arm.helpers import half
from arm.msg import Grip
from ament_index_python.packages import get_package_share_directory
print(__name__, sys.argv, Grip(force=half(3.0)), get_package_share_directory("arm"))
sys.exit(len(sys.argv))
"""


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A workspace without any build."""
    monkeypatch.chdir(tmp_path)
    for name in ("AMENT_PREFIX_PATH", "BUS_RCLPY_FORCE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("PYTHONPATH", sources())
    for path, text in {
        "package.xml": MANIFEST,
        "CMakeLists.txt": CMAKE,
        "msg/Grip.msg": "float64 force\n",
        "arm/__init__.py": "",
        "arm/helpers.py": "def half(x): return x / 2\n",
        "scripts/show.py": SHOW,
        "scripts/plain": f"#!/usr/bin/env python3\n{SHOW}",
    }.items():
        place = tmp_path / "src/robot/arm" / path
        place.parent.mkdir(parents=True, exist_ok=True)
        place.write_text(text)
    return tmp_path


@pytest.fixture
def run(here: Path) -> Run:
    """Runs `bus` with the given arguments."""
    return run_bus


@pytest.mark.parametrize("folder", [".", "src", "src/robot", "src/robot/arm", "src/robot/arm/scripts"])
def test_from_anywhere_in_the_workspace(
    here: Path, run: Run, monkeypatch: pytest.MonkeyPatch, folder: str
) -> None:
    monkeypatch.chdir(here / folder)
    source = here / "src/robot/arm"
    shown = run("run", "arm", "show", "--ros-args")
    argv = [f"{source}/scripts/show.py", "--ros-args"]
    assert shown == (f"__main__ {argv} arm.msg.Grip(force=1.5) {source}\n", shown.err, 2)
    assert shown.err == "[ros2run]: Process exited with failure 2\n"


@pytest.mark.parametrize("name", ["show.py", "plain"])
def test_by_their_names(here: Path, run: Run, name: str) -> None:
    assert run("run", "arm", name).out.startswith("__main__ [")
    assert run("run", "--prefix", "env A=1", "arm", name).out.startswith("__main__ [")


def test_modules_of_dependencies(here: Path, run: Run) -> None:
    """In source form, for CMake or for Python, and those of their dependencies."""
    files = {
        "src/robot/arm/package.xml": MANIFEST.replace("</package>", "<depend>joints</depend></package>"),
        "src/robot/arm/scripts/show.py": "import joints, motors; print(joints.__name__, motors.SPEED)\n",
        "src/joints/package.xml": (
            "<package><name>joints</name><exec_depend>motors</exec_depend><depend>arm</depend>"
            "<depend>rclpy</depend></package>"
        ),
        "src/joints/CMakeLists.txt": "ament_python_install_package(joints PACKAGE_DIR src/joints)\n",
        "src/joints/src/joints/__init__.py": "",
        "src/motors/package.xml": "<package><name>motors</name></package>",
        "src/motors/setup.py": "",
        "src/motors/motors/__init__.py": "SPEED = 5\n",
    }
    for path, text in files.items():
        (here / path).parent.mkdir(parents=True, exist_ok=True)
        (here / path).write_text(text)
    assert run("run", "arm", "show.py") == ("joints 5\n", "", 0)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("arm", "shw.py"), "No executable found\ndid you mean 'show.py'?\n"),
        (("arm", "zzz"), "No executable found\n'arm' has: gone.py, plain, show, show.py\n"),
        (("arm", "driver"), "No executable found\n'driver' must be compiled, with colcon and ROS 2"),
    ],
)
def test_what_is_not_there(here: Path, run: Run, words: tuple[str, ...], text: str) -> None:
    found = run("run", *words)
    assert (found.out, found.code) == ("", 1)
    assert found.err.startswith(text)


def test_a_file_that_is_not_there(here: Path, run: Run) -> None:
    path = here / "src/robot/arm/scripts/gone.py"
    assert run("run", "arm", "gone.py") == (
        "",
        f"bus run: can't run '{path}': No such file or directory\n",
        1,
    )


def test_a_package_without_programs(here: Path, run: Run) -> None:
    cmake = here / "src/robot/arm/CMakeLists.txt"
    cmake.write_text("project(arm)\n")
    found = run("run", "arm", "show")
    assert found.err == (
        "Package 'arm' not found\n'src/robot/arm/CMakeLists.txt' installs no programs: "
        "install(PROGRAMS ... DESTINATION lib/${PROJECT_NAME})\n"
    )
    (cmake.parent / "setup.py").write_text("")
    assert "pip install -e ./src/robot/arm" in run("run", "arm", "show").err


def test_one_that_was_built_goes_first(here: Path, run: Run) -> None:
    built = here / "install/arm/lib/arm/show"
    built.parent.mkdir(parents=True)
    built.write_text("#!/usr/bin/env python3\nprint('built')\n")
    built.chmod(0o755)
    (here / "install/.colcon_install_layout").write_text("isolated\n")
    assert run("run", "arm", "show") == ("built\n", "", 0)
