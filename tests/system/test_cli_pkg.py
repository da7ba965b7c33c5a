"""`bus run PKG EXE` and `bus pkg`: in workspaces, prefixes, and a virtual environment, without a daemon."""

import os
import signal
import subprocess
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import pytest

from packaged import VERSION, WAIT_S, Result, run_bus, sources

SHOW = """\
#!/usr/bin/env python3
import os, sys
import arm_helpers
print(arm_helpers.__name__, __name__, sys.argv, os.environ["AMENT_PREFIX_PATH"])
sys.exit(int(sys.argv[1]) if len(sys.argv) > 1 else 0)
"""
MANIFEST = """\
<?xml version="1.0"?>
<package format="3">
  <name>arm</name>
  <version>1.2.3</version>
  <license>MIT</license>
  <license>BSD</license>
</package>
"""


Run = Callable[..., Result]


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    for name in ("AMENT_PREFIX_PATH", "PYTHONPATH", "BUS_RCLPY_FORCE"):
        monkeypatch.delenv(name, raising=False)
    # For tests of a tree in which busd is not installed.
    monkeypatch.setenv("PYTHONPATH", sources())
    return tmp_path


@pytest.fixture
def run(here: Path) -> Run:
    """Runs `bus` with the given arguments."""
    return run_bus


def program(path: Path, text: str) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(text)
    path.chmod(0o755)


def install(prefix: Path, programs: Mapping[str, str]) -> Path:
    """Writes the files that a build of the package `arm` leaves under a prefix."""
    for name, text in programs.items():
        program(prefix / "lib" / "arm" / name, text)
    marker = prefix / "share/ament_index/resource_index/packages/arm"
    marker.parent.mkdir(parents=True)
    marker.write_text("")
    (prefix / "share/arm").mkdir()
    (prefix / "share/arm/package.xml").write_text(MANIFEST)
    site = prefix / "lib" / VERSION / "site-packages"
    site.mkdir(parents=True)
    (site / "arm_helpers.py").write_text("")
    return prefix


def test_a_prefix_that_is_a_circle_of_links(here: Path, run: Run) -> None:
    (here / "circle").symlink_to("circle")
    path = f"{here}/circle:{install(here / 'p', {'show': SHOW})}"
    assert run("pkg", "prefix", "arm", AMENT_PREFIX_PATH=path) == (f"{here}/p\n", "", 0)


@pytest.mark.parametrize("layout", ["isolated", "merged"])
def test_a_workspace_that_was_not_sourced(here: Path, run: Run, layout: str) -> None:
    prefix = here / "install" / "arm" if layout == "isolated" else here / "install"
    install(prefix, {"show": SHOW})
    (here / "install" / ".colcon_install_layout").write_text(f"{layout}\n")
    shown = run("run", "arm", "show", "0", "--ros-args", "-r", "a:=b")
    argv = [f"{prefix}/lib/arm/show", "0", "--ros-args", "-r", "a:=b"]
    assert (shown.err, shown.code) == ("", 0)
    assert shown.out.startswith(f"arm_helpers __main__ {argv} ")
    assert str(prefix) in shown.out.split()[-1].split(os.pathsep)
    assert run("pkg", "list").out.splitlines().count("arm") == 1
    assert run("pkg", "prefix", "arm") == (f"{prefix}\n", "", 0)


def test_from_within_a_workspace(here: Path, run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    install(here / "install" / "arm", {"show": SHOW})
    (here / "install" / "setup.sh").write_text("")
    (here / "src" / "arm").mkdir(parents=True)
    monkeypatch.chdir(here / "src" / "arm")
    assert run("run", "arm", "show").code == 0


def test_a_link_of_a_symlinked_build(here: Path, run: Run) -> None:
    prefix = install(here / "install" / "arm", {"show": SHOW})
    (here / "install" / "setup.sh").write_text("")
    site = prefix / "lib" / VERSION / "site-packages"
    (here / "build").mkdir()
    (site / "arm_helpers.py").rename(here / "build" / "arm_helpers.py")
    (site / "arm.egg-link").write_text(f"{here}/build\n.")
    assert run("run", "arm", "show").code == 0


def test_a_sourced_prefix_goes_first(here: Path, run: Run) -> None:
    install(here / "first", {"show": SHOW})
    install(here / "install" / "arm", {"show": "#!/bin/sh\nfalse\n"})
    (here / "install" / "setup.sh").write_text("")
    path = f"{here}/nowhere:{here}/first"
    shown = run("run", "arm", "show", AMENT_PREFIX_PATH=path)
    assert (shown.out.split()[-1], shown.code) == (path, 0)
    assert run("pkg", "prefix", "arm", AMENT_PREFIX_PATH=path).out == f"{here}/first\n"


def test_a_prefix_that_has_only_programs(here: Path, run: Run) -> None:
    program(here / "p" / "lib" / "arm" / "hello", "#!/bin/sh\necho hello $1\n")
    assert run("run", "arm", "hello", "you", AMENT_PREFIX_PATH=f"{here}/p") == ("hello you\n", "", 0)


@pytest.mark.parametrize(
    ("text", "code", "said"),
    [
        ("#!/bin/sh\nexit 7\n", 7, "[ros2run]: Process exited with failure 7\n"),
        ("#!/bin/sh\nkill -SEGV $$\n", 128 + signal.SIGSEGV, "[ros2run]: Segmentation fault\n"),
        ("#!/bin/sh\nkill -INT $$\n", -signal.SIGINT, ""),
        ("#!/usr/bin/env python3\nraise SystemExit(3)\n", 3, "[ros2run]: Process exited with failure 3\n"),
        (
            "#!/usr/bin/env python3\nraise SystemExit('so')\n",
            1,
            "so\n[ros2run]: Process exited with failure 1\n",
        ),
        ("#!/usr/bin/env python3\nraise KeyboardInterrupt\n", -signal.SIGINT, ""),
        ("no program\n", 1, "bus run: can't run '"),
    ],
)
def test_how_a_program_ended(here: Path, run: Run, text: str, code: int, said: str) -> None:
    install(here / "p", {"it": text})
    found = run("run", "arm", "it", AMENT_PREFIX_PATH=f"{here}/p")
    assert (found.out, found.code) == ("", code)
    assert found.err.startswith(said)
    assert bool(found.err) == bool(said)


def test_a_signal_reaches_a_child(here: Path) -> None:
    install(
        here / "p", {"it": '#!/bin/sh\ntrap "echo bye; exit 4" TERM\necho up\nwhile :; do sleep 0.05; done\n'}
    )
    with subprocess.Popen(
        [sys.executable, "-m", "bus_cli", "run", "arm", "it"],
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        env={**os.environ, "AMENT_PREFIX_PATH": f"{here}/p"},
    ) as process:
        try:
            assert process.stdout is not None
            assert process.stdout.readline() == "up\n"
            process.terminate()
            told = process.communicate(timeout=WAIT_S)
        finally:
            process.kill()
    assert (*told, process.returncode) == ("bye\n", "[ros2run]: Process exited with failure 4\n", 4)


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("arn", "show"), "Package 'arn' not found\ndid you mean 'arm'?\n"),
        (("../x", "show"), "bus run: '../x' does not exist\n"),
        (("qqqqqqq", "show"), "Package 'qqqqqqq' not found\n"),
        (("arm", "shew"), "No executable found\ndid you mean 'show'?\n"),
        (("arm", "zzz"), "No executable found\n'arm' has: double, double, show\n"),
        (
            ("gripper", "roll"),
            "Package 'gripper' not found\n'src/gripper' is not installed: pip install -e ./src/gripper",
        ),
    ],
)
def test_what_is_not_there(here: Path, run: Run, words: tuple[str, ...], text: str) -> None:
    install(here / "p", {"show": SHOW, "double": SHOW, "sub/double": SHOW})
    (here / "src" / "gripper").mkdir(parents=True)
    (here / "src" / "gripper" / "package.xml").write_text(MANIFEST)
    found = run("run", *words, AMENT_PREFIX_PATH=f"{here}/p")
    assert (found.out, found.code) == ("", 1)
    assert found.err.startswith(text)


def test_two_of_one_name(here: Path, run: Run) -> None:
    install(here / "p", {"double": SHOW, "sub/double": SHOW})
    found = run("run", "arm", "double", AMENT_PREFIX_PATH=f"{here}/p")
    folder = f"{here}/p/lib/arm"
    assert found == ("", f"Multiple executables found:\n- {folder}/double\n- {folder}/sub/double\n", 1)


def test_a_package_without_a_program(here: Path, run: Run) -> None:
    install(here / "p", {"show": SHOW})
    for words in (("arm",), ("arm", "--ros-args")):
        found = run("run", *words, AMENT_PREFIX_PATH=f"{here}/p")
        assert (found.out, found.code) == ("", 2)
        assert found.err.endswith(
            "bus run: error: the following arguments are required: executable_name\n'arm' has: show\n"
        )


def test_the_verbs_of_pkg(here: Path, run: Run) -> None:
    install(here / "p", {"show": SHOW, "b": SHOW})
    (here / "p/lib/arm/data.txt").write_text("not a program")
    variables = {"AMENT_PREFIX_PATH": f"{here}/p"}
    assert "arm" in run("pkg", "list", **variables).out.splitlines()
    assert run("pkg", "executables", "arm", **variables).out == "arm b\narm show\n"
    assert "arm b\narm show\n" in run("pkg", "executables", **variables).out
    full = run("pkg", "executables", "--full-path", "arm", **variables).out
    assert full == f"{here}/p/lib/arm/b\n{here}/p/lib/arm/show\n"
    assert run("pkg", "prefix", "arm", "--share", **variables).out == f"{here}/p/share/arm\n"
    assert "<version>1.2.3</version>" in run("pkg", "xml", "arm", **variables).out
    assert run("pkg", "xml", "arm", "-t", "license", **variables).out == "MIT\nBSD\n"
    assert run("pkg", "list", "--json", **variables).out.startswith('{"package":"')


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (("executables", "nosuch"), "Package 'nosuch' not found\n"),
        (("prefix", "nosuch"), "Package not found\n"),
        (("prefix", ""), "Package not found\n"),
        (("xml", "../share"), "Package not found\n"),
        (("xml", "arm", "--tag", "nosuch"), "XML tag not found\n"),
        (("xml", "bare"), "Package xml manifest not found\n"),
    ],
)
def test_what_pkg_does_not_find(here: Path, run: Run, words: tuple[str, ...], text: str) -> None:
    install(here / "p", {})
    (here / "p" / "lib" / "bare").mkdir()
    assert run("pkg", *words, AMENT_PREFIX_PATH=f"{here}/p") == ("", text, 1)


def test_a_manifest_that_is_no_xml(here: Path, run: Run) -> None:
    path = install(here / "p", {}) / "share/arm/package.xml"
    path.write_text("<package>")
    found = run("pkg", "xml", "arm", AMENT_PREFIX_PATH=f"{here}/p")
    assert found.code == 1
    assert found.err.startswith(f"{path} is not XML: ")
