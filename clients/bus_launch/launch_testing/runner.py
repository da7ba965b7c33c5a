"""Runs a test file: launches its description, runs its tests during the launch and after it, ends everything.

The launch has this thread, because signals arrive there; the tests have another. Must not know: command
lines.
"""

import inspect
import threading
import unittest
from collections.abc import Callable, Mapping
from typing import Any

from bus_launch.launch.actions import RegisterEventHandler, SetLaunchConfiguration
from bus_launch.launch.core import EventHandler
from bus_launch.launch.events.process import ProcessIO, RunningProcessEvent
from bus_launch.launch.launch_description import LaunchDescription
from bus_launch.launch.launch_description_sources import load_python_launch_file_as_module
from bus_launch.launch.launch_service import LaunchService
from bus_launch.launch_testing.actions import ready_actions
from bus_launch.launch_testing.processes import ActiveIoHandler, ActiveProcInfoHandler
from bus_launch.launch_testing.ready import TIMEOUT_S

__all__ = ["run_file", "run_module"]

Runner = Callable[[unittest.TestSuite], unittest.TestResult]


def run_file(path: str, arguments: Mapping[str, str], *, verbosity: int = 1) -> bool:
    """Run the tests of a file; returns whether all passed. Raises an error of the file itself."""
    module = load_python_launch_file_as_module(path)
    if not hasattr(module, "generate_test_description"):
        raise RuntimeError(f"'{path}' has no generate_test_description()")
    return run_module(module, arguments, unittest.TextTestRunner(verbosity=verbosity).run)


def run_module(module: Any, arguments: Mapping[str, str], run: Runner) -> bool:
    """Run the tests of a module, in all its launches; returns whether all passed. `run` runs a suite."""
    make = module.generate_test_description
    rows = make() if hasattr(make, "__parametrized__") else [(make, {})]
    # All launches, also after a failure.
    results = [_Run(module, one, row, arguments, run).run() for one, row in rows]
    return all(results)


class _Run:
    """One launch, with one row of parameters."""

    def __init__(
        self, module: Any, make: Any, row: Mapping[str, Any], arguments: Mapping[str, str], run: Runner
    ) -> None:
        self._run_suite = run
        self._timeout = getattr(make, "__ready_to_test_action_timeout__", TIMEOUT_S)
        self._ready = threading.Event()
        self._info = ActiveProcInfoHandler()
        self._output = ActiveIoHandler()
        wanted = inspect.signature(make).parameters
        made = make(ready_fn=self._ready.set) if "ready_fn" in wanted else make()
        description, context = made if isinstance(made, tuple) else (made, {})
        ready = ready_actions(description)
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
        problem: BaseException | None = None

        def test() -> None:
            nonlocal has_passed, problem
            is_ready = self._ready.wait(self._timeout)
            if is_over.is_set():
                return
            try:
                if is_ready:
                    has_passed = self._test(self._before)
                else:
                    print(f"Timed out waiting for processes to start up: not ready after {self._timeout:g} s")
            except BaseException as error:  # it belongs to the caller, and the launch must end all the same
                problem = error
            self._service.shutdown()

        is_over = threading.Event()
        thread = threading.Thread(target=test, name="tests", daemon=True)
        thread.start()
        code = self._service.run()
        was_ready = self._ready.is_set()
        is_over.set()
        self._ready.set()
        thread.join()
        if problem is not None:
            raise problem
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
        return self._run_suite(suite).wasSuccessful()


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
