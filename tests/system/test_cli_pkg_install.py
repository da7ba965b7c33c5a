"""Packages installed by pip or colcon: their programs, and their metadata in Python."""

import importlib.util
import os
import shutil
import signal
import subprocess
import sys
import venv
from pathlib import Path

import pytest

from packaged import VERSION, WAIT_S, run_bus, sources

pytestmark = pytest.mark.landing


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("AMENT_PREFIX_PATH", "PYTHONPATH", "BUS_RCLPY_FORCE"):
        monkeypatch.delenv(name, raising=False)
    # For tests of a tree in which busd is not installed.
    monkeypatch.setenv("PYTHONPATH", sources())
    return tmp_path


@pytest.fixture
def environment(here: Path) -> Path:
    """A virtual environment with the same packages as this one."""
    folder = here / "env"
    venv.create(folder)
    site = folder / "lib" / VERSION / "site-packages"
    paths = [*sources().split(os.pathsep), *(path for path in sys.path if "site-packages" in path)]
    (site / "tests.pth").write_text("\n".join(paths))
    return folder


def distribution(environment: Path, entry_points: str) -> None:
    site = environment / "lib" / VERSION / "site-packages"
    (site / "my_arm-1.0.dist-info").mkdir()
    (site / "my_arm-1.0.dist-info" / "METADATA").write_text("Name: my-arm\nVersion: 1.0\n")
    (site / "my_arm-1.0.dist-info" / "entry_points.txt").write_text(entry_points)


@pytest.mark.parametrize("name", [pytest.param("my_arm", marks=pytest.mark.nightly), "My.Arm"])
def test_a_console_script_of_a_distribution(here: Path, environment: Path, name: str) -> None:
    text = "[gui_scripts]\nno = x:y\n[console_scripts]\n# talkers\nshow = arm.node:Show.main [extra]\n"
    distribution(environment, text)
    site = environment / "lib" / VERSION / "site-packages"
    (site / "arm").mkdir()
    (site / "arm" / "node.py").write_text(
        "import sys\nclass Show:\n    @staticmethod\n    def main():\n        print(sys.argv, sys.path[0])\n"
        "        return 3\n"
    )
    python = str(environment / "bin" / "python")
    argv = [f"{environment}/bin/show", "a", "--ros-args"]
    assert run_bus("run", name, "show", "a", "--ros-args", python=python) == (
        f"{argv} {environment}/bin\n",
        "[ros2run]: Process exited with failure 3\n",
        3,
    )
    assert run_bus("pkg", "executables", name, python=python).out == f"{name} show\n"
    assert run_bus("pkg", "prefix", name, python=python).out == f"{environment}\n"


def test_errors_of_a_console_script_look_like_pythons(here: Path, environment: Path) -> None:
    distribution(environment, "[console_scripts]\nbad = arm_bad:main\nnone = arm_none:main\n")
    site = environment / "lib" / VERSION / "site-packages"
    (site / "arm_bad.py").write_text("def main():\n    raise ValueError(1)\n")
    python = str(environment / "bin" / "python")
    found = run_bus("run", "my_arm", "bad", python=python)
    assert found.err.startswith(
        f'Traceback (most recent call last):\n  File "{site}/arm_bad.py", line 2, in main\n'
    )
    assert found.err.endswith("\nValueError: 1\n[ros2run]: Process exited with failure 1\n")
    assert run_bus("run", "my_arm", "none", python=python) == (
        "",
        "ModuleNotFoundError: No module named 'arm_none'\n[ros2run]: Process exited with failure 1\n",
        1,
    )


def create(where: Path) -> Path:
    done = run_bus(
        *("pkg", "create", "--build-type", "ament_python", "--node-name", "talker"),
        *("--destination-directory", str(where), "py_pubsub"),
    )
    assert done.code == 0
    return where / "py_pubsub"


@pytest.mark.skipif(
    not (importlib.util.find_spec("pip") and importlib.util.find_spec("setuptools")),
    reason="needs pip and setuptools",
)
@pytest.mark.parametrize("way", [pytest.param(["-e"], marks=pytest.mark.nightly), []])
def test_a_new_package_with_pip(here: Path, environment: Path, way: list[str]) -> None:
    package = create(here)
    python = str(environment / "bin" / "python")
    subprocess.run(
        [
            *(
                sys.executable,
                "-m",
                "pip",
                "--python",
                python,
                "install",
                "--no-build-isolation",
                "--no-deps",
            ),
            *("--no-index", "--disable-pip-version-check", *way, str(package)),
        ],
        capture_output=True,
        timeout=WAIT_S,
        check=True,
    )
    assert run_bus("run", "py_pubsub", "talker", python=python) == ("Hi from py_pubsub.\n", "", 0)
    assert "py_pubsub" in run_bus("pkg", "list", python=python).out.splitlines()
    assert run_bus("pkg", "executables", "py_pubsub", python=python).out == "py_pubsub talker\n"
    assert run_bus("pkg", "xml", "py_pubsub", "-t", "name", python=python).out == "py_pubsub\n"


@pytest.mark.skipif(not shutil.which("colcon"), reason="needs colcon")
@pytest.mark.parametrize("way", [[], ["--symlink-install"], ["--merge-install"]])
def test_a_new_package_with_colcon(here: Path, way: list[str]) -> None:
    create(here / "src")
    subprocess.run(["colcon", "build", *way], capture_output=True, timeout=WAIT_S, check=True)
    assert run_bus("run", "py_pubsub", "talker") == ("Hi from py_pubsub.\n", "", 0)
    assert run_bus("pkg", "executables", "py_pubsub").out == "py_pubsub talker\n"


TALKER = """\
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

class Talker(Node):
    def __init__(self):
        super().__init__('talker')
        self.publisher = self.create_publisher(String, 'topic', 10)
        self.create_timer(0.05, self.say)

    def say(self):
        self.publisher.publish(String(data='hello'))

def main():
    rclpy.init()
    print('up', flush=True)
    rclpy.spin(Talker())
"""
LISTENER = """\
import sys
import rclpy
from rclpy.node import Node
from std_msgs.msg import String

def main():
    rclpy.init()
    node = Node('listener')
    heard = []
    node.create_subscription(String, 'topic', heard.append, 10)
    while not heard:
        rclpy.spin_once(node)
    print(node.get_name(), heard[0])
    node.destroy_node()
    rclpy.shutdown()
"""


@pytest.mark.parametrize("number", [signal.SIGINT, pytest.param(signal.SIGTERM, marks=pytest.mark.nightly)])
def test_a_package_on_the_bus(here: Path, environment: Path, daemon: object, number: signal.Signals) -> None:
    """A program that catches nothing ends without a traceback."""
    distribution(environment, "[console_scripts]\ntalker = arm_talker:main\nlistener = arm_listener:main\n")
    site = environment / "lib" / VERSION / "site-packages"
    (site / "arm_talker.py").write_text(TALKER)
    (site / "arm_listener.py").write_text(LISTENER)
    python = str(environment / "bin" / "python")
    with subprocess.Popen(
        [python, "-m", "bus_cli", "run", "my_arm", "talker"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    ) as talker:
        try:
            assert talker.stdout is not None
            assert talker.stdout.readline() == "up\n"
            words = ("listener", "--ros-args", "-r", "__node:=ear")
            heard = run_bus("run", "my_arm", *words, python=python)
            assert heard == ("ear std_msgs.msg.String(data='hello')\n", "", 0)
            talker.send_signal(number)
            told = talker.communicate(timeout=WAIT_S)
        finally:
            talker.kill()
    assert (*told, talker.returncode) == ("", "", -number)


def test_the_tests_of_a_new_package_pass_without_ros(here: Path) -> None:
    package = create(here)
    done = subprocess.run(
        [sys.executable, "-m", "pytest", "-q", "-p", "no:cacheprovider"],
        cwd=package,
        capture_output=True,
        text=True,
        timeout=WAIT_S,
        check=False,
    )
    assert "3 skipped" in done.stdout, done.stdout
    assert done.returncode == 5 or done.returncode == 0  # 5: all modules are skipped
