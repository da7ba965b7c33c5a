"""Runs a test file: launches its description, runs its tests during the launch and after it, ends everything.

The launch has this thread, because signals arrive there; the tests have another. Must not know: command
lines.
"""

import inspect
import threading
import unittest
from collections.abc import Mapping
from typing import Any

from bus_launch.launch.actions import RegisterEventHandler, SetLaunchConfiguration
from bus_launch.launch.core import EventHandler, LaunchDescriptionEntity
from bus_launch.launch.events.process import ProcessIO, RunningProcessEvent
from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch.launch_description_sources import load_python_launch_file_as_module
from bus_launch.launch.launch_service import LaunchService
from bus_launch.launch_testing.actions import ReadyToTest
from bus_launch.launch_testing.processes import ActiveIoHandler, ActiveProcInfoHandler

__all__ = ["run_file"]


def run_file(path: str, arguments: Mapping[str, str], *, verbosity: int = 1) -> bool:
    """Whether all tests of a file passed. Raises the file's error."""
    module = load_python_launch_file_as_module(path)
    make = getattr(module, "generate_test_description", None)
    if make is None:
        raise RuntimeError(f"'{path}' has no generate_test_description()")
    rows = getattr(make, "__parametrized__", [{}])
    results = [
        _Run(module, make, row, arguments, verbosity).run() for row in rows
    ]  # all, also after a failure
    return all(results)


class _Run:
    """One launch, with one row of parameters."""

    def __init__(
        self, module: Any, make: Any, row: Mapping[str, Any], arguments: Mapping[str, str], verbosity: int
    ) -> None:
        self._verbosity = verbosity
        self._ready = threading.Event()
        self._info = ActiveProcInfoHandler()
        self._output = ActiveIoHandler(self._info)
        wanted = inspect.signature(make).parameters
        given = dict(row)
        if "ready_fn" in wanted:
            given["ready_fn"] = self._ready.set
        made = make(**given)
        description, context = made if isinstance(made, tuple) else (made, {})
        ready = [one for one in _all_of(description) if isinstance(one, ReadyToTest)]
        if not ready and "ready_fn" not in wanted:
            raise RuntimeError("generate_test_description needs a launch_testing.actions.ReadyToTest()")
        for one in ready:
            one._add_callback(self._ready.set)
        self._service = LaunchService(argv=[f"{name}:={value}" for name, value in arguments.items()])
        setters = [SetLaunchConfiguration(name, value) for name, value in arguments.items()]
        watch = RegisterEventHandler(
            EventHandler(matcher=lambda event: isinstance(event, RunningProcessEvent) and self._note(event))
        )
        self._service.include_launch_description(LaunchDescription([watch, *setters, description]))
        self._values = {
            **row,
            **context,
            "launch_service": self._service,
            "proc_info": self._info,
            "proc_output": self._output,
            "test_args": dict(arguments),
        }
        classes = [
            one
            for one in vars(module).values()
            if isinstance(one, type)
            and issubclass(one, unittest.TestCase)
            and one.__module__ == module.__name__
        ]
        self._before = [one for one in classes if not hasattr(one, "__post_shutdown_test__")]
        self._after = [one for one in classes if hasattr(one, "__post_shutdown_test__")]

    def run(self) -> bool:
        has_passed = False

        def test() -> None:
            nonlocal has_passed
            self._ready.wait()
            if not is_over.is_set():
                has_passed = self._test(self._before)
                self._service.shutdown()

        is_over = threading.Event()
        thread = threading.Thread(target=test, name="tests", daemon=True)
        thread.start()
        code = self._service.run()
        was_ready = self._ready.is_set()
        is_over.set()
        self._ready.set()
        thread.join()
        if not was_ready:
            print("Processes under test stopped before tests completed")
        return self._test(self._after) and has_passed and was_ready and code == 0

    def _note(self, event: RunningProcessEvent) -> bool:
        """Takes no part in the launch: the event is not handled here."""
        if isinstance(event, ProcessIO):
            self._output.append(event)
        else:
            self._info.append(event)
        return False

    def _test(self, classes: list[type[unittest.TestCase]]) -> bool:
        suite = unittest.TestSuite()
        for one in classes:
            for name, value in self._values.items():
                setattr(one, name, value)
            for test in unittest.defaultTestLoader.loadTestsFromTestCase(one):
                assert isinstance(test, unittest.TestCase)
                _bind(test, self._values)
                suite.addTest(test)
        if not suite.countTestCases():
            return True
        return unittest.TextTestRunner(verbosity=self._verbosity).run(suite).wasSuccessful()


def _bind(test: unittest.TestCase, values: Mapping[str, Any]) -> None:
    """Tests, setUp and the like name the objects of the launch that they want as arguments."""
    for name in (test._testMethodName, "setUp", "tearDown"):
        method = getattr(test, name)
        wanted = [one for one in inspect.signature(method).parameters if one in values]
        if wanted:
            given = {one: values[one] for one in wanted}
            setattr(test, name, lambda method=method, given=given: method(**given))
    for name in ("setUpClass", "tearDownClass"):
        method = getattr(type(test), name)
        wanted = [one for one in inspect.signature(method).parameters if one in values]
        if wanted:
            given = {one: values[one] for one in wanted}
            setattr(type(test), name, lambda method=method, given=given: method(**given))


def _all_of(entity: LaunchDescriptionEntity) -> list[LaunchDescriptionEntity]:
    found = [entity]
    below = list(entity.describe_sub_entities())
    for _, others in entity.describe_conditional_sub_entities():
        below += others
    for one in below:
        found += _all_of(one)
    return found
