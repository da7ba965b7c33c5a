"""Runs launch tests in pytest: `bus run -m pytest -p launch_testing.pytest.hooks FILE`.

A file is one test if its `generate_test_description` has the mark `launch_test`. Must not know: how a launch
runs (`runner.py`).
"""

import unittest
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import pytest
from _pytest.pathlib import import_path

from bus_launch.launch_testing.runner import run_module

__all__ = ["pytest_addoption", "pytest_configure", "pytest_pycollect_makemodule"]

_MARK = "launch_test"


class _Failed(Exception):
    """Tests of a launch failed; has their descriptions."""


class _LaunchTest(pytest.Item):
    """All tests of a file."""

    def __init__(self, *, module: Any, **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._module = module

    def runtest(self) -> None:
        words = [word for group in self.config.getoption("--launch-args") for word in group]
        arguments = {name: value for name, _, value in (word.partition(":=") for word in words)}
        failures: list[str] = []

        def run(suite: unittest.TestSuite) -> unittest.TestResult:
            result = unittest.TestResult()
            suite.run(result)
            failures.extend(f"FAIL: {test.id()}\n{text}" for test, text in result.failures + result.errors)
            failures.extend(f"FAIL: {test.id()}: unexpected success" for test in result.unexpectedSuccesses)
            return result

        if not run_module(self._module, arguments, run):
            raise _Failed("\n".join(failures or ["the launch ended before its tests, or with an error"]))

    def repr_failure(self, excinfo: Any, style: Any = None) -> Any:
        if isinstance(excinfo.value, _Failed):
            return str(excinfo.value)
        return super().repr_failure(excinfo, style)

    def reportinfo(self) -> tuple[Path, int, str]:
        return self.path, 0, f"launch tests: {self.name}"


class _LaunchTestModule(pytest.File):
    """A file of launch tests."""

    def __init__(self, *, module: Any, marks: Iterable[Any], **kwargs: Any) -> None:
        super().__init__(**kwargs)
        self._module = module
        for mark in marks:
            self.add_marker(getattr(pytest.mark, mark.name).with_args(*mark.args, **mark.kwargs))

    def collect(self) -> Iterator[pytest.Item]:
        yield _LaunchTest.from_parent(self, name=self._module.__name__, module=self._module)


def pytest_pycollect_makemodule(module_path: Path, parent: Any) -> pytest.File | None:
    if b"generate_test_description" not in module_path.read_bytes():
        return None  # pytest's own; other files are not imported here
    module = import_path(module_path, root=parent.config.rootpath, consider_namespace_packages=False)
    marks = getattr(getattr(module, "generate_test_description", None), "pytestmark", [])
    if not any(mark.name == _MARK for mark in marks):
        return None
    return _LaunchTestModule.from_parent(parent, path=module_path, module=module, marks=marks)


def pytest_addoption(parser: pytest.Parser) -> None:
    parser.addoption(
        "--launch-args", action="append", nargs="*", default=[], help="arguments of launch tests: name:=value"
    )


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line(
        "markers", f"{_MARK}: a generate_test_description with this mark makes its file a launch test"
    )
