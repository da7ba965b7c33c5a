"""`bus pkg create`: its output, its files, and its refusals."""

import ast
import configparser
import os
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import pytest

from bus_cli.main import run
from bus_cli.pkg import templates
from rows import for_each

PYTHON = ("--build-type", "ament_python", "--maintainer-name", "Ann", "--maintainer-email", "ann@here.org")


@pytest.fixture(autouse=True)
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("GIT_CONFIG_GLOBAL", os.devnull)
    monkeypatch.setenv("GIT_CONFIG_NOSYSTEM", "1")
    return tmp_path


def create(*words: str) -> int:
    return run(["pkg", "create", *words])


def setup_arguments(text: str) -> dict[str, Any]:
    """The arguments that setup.py passes to setup(), if they can be read without running it."""
    call = ast.parse(text).body[-1]
    assert isinstance(call, ast.Expr)
    assert isinstance(call.value, ast.Call)
    found = {}
    for keyword in call.value.keywords:
        try:
            found[str(keyword.arg)] = ast.literal_eval(keyword.value)
        except ValueError:
            found[str(keyword.arg)] = ast.unparse(keyword.value)
    return found


def test_it_says_what_it_does_as_ros2(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    words = ("--node-name", "talker", "--license", "MIT", "--dependencies", "rclpy", "std_msgs")
    assert create("py_pubsub", *PYTHON, *words) == 0
    assert capsys.readouterr().out.splitlines() == [
        "going to create a new package",
        "package name: py_pubsub",
        f"destination directory: {here}",
        "package format: 3",
        "version: 0.0.0",
        "description: TODO: Package description",
        "maintainer: ['Ann <ann@here.org>']",
        "licenses: ['MIT']",
        "build type: ament_python",
        "dependencies: ['rclpy', 'std_msgs']",
        "node_name: talker",
        "creating folder ./py_pubsub",
        "creating ./py_pubsub/package.xml",
        "creating source folder",
        "creating folder ./py_pubsub/py_pubsub",
        "creating ./py_pubsub/setup.py",
        "creating ./py_pubsub/setup.cfg",
        "creating folder ./py_pubsub/resource",
        "creating ./py_pubsub/resource/py_pubsub",
        "creating ./py_pubsub/py_pubsub/__init__.py",
        "creating folder ./py_pubsub/test",
        "creating ./py_pubsub/test/test_copyright.py",
        "creating ./py_pubsub/test/test_flake8.py",
        "creating ./py_pubsub/test/test_pep257.py",
        "creating ./py_pubsub/py_pubsub/talker.py",
    ]


def test_all_files_are_there(here: Path) -> None:
    assert create("--build-type", "ament_python", "--license", "Apache-2.0", "py_pubsub") == 0
    found = {str(path.relative_to(here)) for path in here.rglob("*") if path.is_file()}
    assert found == {
        f"py_pubsub/{name}"
        for name in (
            "LICENSE",
            "package.xml",
            "py_pubsub/__init__.py",
            "resource/py_pubsub",
            "setup.cfg",
            "setup.py",
            "test/test_copyright.py",
            "test/test_flake8.py",
            "test/test_pep257.py",
        )
    }


def test_the_manifest(here: Path) -> None:
    words = ("--description", "a < b & c", "--license", "BSD-3-Clause", "--dependencies", "rclpy", "std_msgs")
    assert create("arm", *PYTHON, *words) == 0
    root = ElementTree.parse(here / "arm" / "package.xml").getroot()
    assert (root.tag, root.get("format")) == ("package", "3")
    texts = {
        name: root.findtext(name) for name in ("name", "version", "description", "license", "maintainer")
    }
    assert texts == {
        "name": "arm",
        "version": "0.0.0",
        "description": "a < b & c",
        "license": "BSD-3-Clause",
        "maintainer": "Ann",
    }
    maintainer = root.find("maintainer")
    assert maintainer is not None
    assert maintainer.get("email") == "ann@here.org"
    assert [one.text for one in root.findall("depend")] == ["rclpy", "std_msgs"]
    assert root.findtext("export/build_type") == "ament_python"


def test_the_older_format(here: Path) -> None:
    assert create("arm", *PYTHON, "--package-format", "2") == 0
    text = (here / "arm" / "package.xml").read_text()
    assert '<package format="2">' in text
    assert "package_format2.xsd" in text


def test_setup_py(here: Path) -> None:
    assert create("arm", *PYTHON, "--node-name", "grip", "--description", 'it\'s "it"') == 0
    found = setup_arguments((here / "arm" / "setup.py").read_text())
    assert found["description"] == 'it\'s "it"'
    assert found["maintainer"] == "Ann"
    assert found["maintainer_email"] == "ann@here.org"
    assert found["entry_points"] == {"console_scripts": ["grip = arm.grip:main"]}
    assert found["packages"] == "find_packages(exclude=['test'])"


def test_the_lesson_can_add_its_lines(here: Path) -> None:
    """The lesson says: add the program within the brackets of console_scripts, and the dependencies after the
    license.
    """
    assert create("arm", *PYTHON) == 0
    text = (here / "arm" / "setup.py").read_text()
    brackets = "        'console_scripts': [\n        ],\n"
    assert brackets in text
    line = "'talker = arm.publisher_member_function:main',"
    edited = text.replace(brackets, f"        'console_scripts': [\n            {line}\n        ],\n")
    assert setup_arguments(edited)["entry_points"]["console_scripts"] == [line.strip("',")]
    manifest = (here / "arm" / "package.xml").read_text()
    assert "</license>\n\n  <test_depend>" in manifest


def test_setup_cfg_puts_programs_where_ros2_run_looks(here: Path) -> None:
    assert create("arm", *PYTHON) == 0
    config = configparser.ConfigParser(interpolation=None)
    config.read(here / "arm" / "setup.cfg")
    assert config["develop"]["script_dir"] == "$base/lib/arm"
    assert config["install"]["install_scripts"] == "$base/lib/arm"


def test_the_node_says_hi(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert create("arm", *PYTHON, "--node-name", "grip") == 0
    capsys.readouterr()
    exec((here / "arm" / "arm" / "grip.py").read_text(), {"__name__": "__main__"})
    assert capsys.readouterr().out == "Hi from arm.\n"


@for_each("linter", templates.LINTERS)
def test_linters_that_are_not_there_are_skipped(linter: str) -> None:
    with pytest.raises(pytest.skip.Exception, match=f"ament_{linter} comes with ROS 2"):
        exec(templates.linter_test(linter), {})


def test_a_library(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert create("arm", *PYTHON, "--library-name", "grip", "--node-name", "grip") == 0
    told = capsys.readouterr()
    assert told.err == (
        "[WARNING] node name can not be equal to the library name\n[WARNING] renaming node to grip_node\n"
    )
    assert "node_name: grip_node\nlibrary_name: grip\n" in told.out
    assert (here / "arm" / "arm" / "grip" / "__init__.py").is_file()
    assert (here / "arm" / "arm" / "grip_node.py").is_file()


def test_another_place(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert create("arm", *PYTHON, "--destination-directory", "a/b") == 0
    assert "creating folder a/b/arm\n" in capsys.readouterr().out
    assert (here / "a" / "b" / "arm" / "setup.py").is_file()


@pytest.mark.parametrize("name", ["MIT", "BSD-3-Clause"])
def test_a_license_has_its_holder(here: Path, name: str) -> None:
    assert create("arm", *PYTHON, "--license", name) == 0
    text = (here / "arm" / "LICENSE").read_text()
    assert "Ann\n" in text
    assert "{holder}" not in text


def test_the_apache_license_is_whole(here: Path) -> None:
    assert create("arm", *PYTHON, "--license", "Apache-2.0") == 0
    text = (here / "arm" / "LICENSE").read_text()
    assert "Version 2.0, January 2004" in text
    assert "END OF TERMS AND CONDITIONS" in text


@pytest.mark.parametrize("name", [None, "Mine", "../templates"])
def test_a_license_that_is_not_known(
    here: Path, name: str | None, capsys: pytest.CaptureFixture[str]
) -> None:
    assert create("arm", *PYTHON, *(("--license", name) if name else ())) == 0
    shown = name or "TODO: License declaration"
    assert capsys.readouterr().out.endswith(
        f"\n[WARNING]: Unknown license '{shown}'.  This has been set in the package.xml, but no LICENSE file "
        "has been created.\nIt is recommended to use one of the ament license identifiers:\n"
        "Apache-2.0\nBSD-3-Clause\nMIT\n"
    )
    assert not (here / "arm" / "LICENSE").exists()


def test_the_known_licenses(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert create("arm", "--license", "?") == 0
    assert capsys.readouterr().out == "Supported licenses:\nApache-2.0\nBSD-3-Clause\nMIT\n"
    assert list(here.iterdir()) == []


def test_without_an_email_there_is_one_to_fill_in(here: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", str(here))  # no git
    assert create("arm", "--build-type", "ament_python", "--maintainer-name", "Ann") == 0
    assert "email='Ann@todo.todo'" in (here / "arm" / "setup.py").read_text()


@pytest.mark.parametrize(
    ("words", "text"),
    [
        (
            ("test", *PYTHON),
            "Aborted since 'ament_python' packages can't be named 'test'. "
            "Please choose a different package name.\n",
        ),
        (
            ("there", *PYTHON),
            "\nAborted!\nThe directory already exists: ./there\nEither remove the directory or choose a "
            "different destination directory or package name\n",
        ),
        (
            ("arm",),
            "busd has no build type 'ament_cmake': it runs Python. Use --build-type ament_python\n",
        ),
        (("arm", *PYTHON, "--node-name", "a-b"), "the node name 'a-b' can't be a Python module\n"),
        (("arm", *PYTHON, "--library-name", "1"), "the library name '1' can't be a Python module\n"),
        *(
            (
                (name, *PYTHON),
                f'Package name "{name}" does not follow the naming conventions. It should start with a lower '
                "case letter and only contain lower case letters, digits, underscores, and dashes.\n",
            )
            for name in ("a/b", "9b", "my-arm", "my arm", "class", "_a", "", "..", "ärm")
        ),
    ],
)
def test_what_is_refused(
    here: Path, words: tuple[str, ...], text: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (here / "there").mkdir()
    assert create(*words) == 1
    assert capsys.readouterr() == ("", text)
    assert [path.name for path in here.rglob("*")] == ["there"]


def test_capitals_are_not_liked(here: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert create("MyArm", *PYTHON) == 0
    assert capsys.readouterr().err.startswith('[WARNING]: Package name "MyArm" does not follow the naming')
    assert (here / "MyArm" / "MyArm" / "__init__.py").is_file()
