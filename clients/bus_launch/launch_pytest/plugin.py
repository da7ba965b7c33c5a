"""Hooks of pytest for tests with the mark `launch`, loaded by `-p launch_pytest.plugin`.

    @pytest.mark.launch(fixture=F)                 while the launch of F runs
    @pytest.mark.launch(fixture=F, shutdown=True)  after its end
    a generator                                    up to its only `yield` while it runs, the rest after it

A coroutine runs in the loop of the launch, a function in another thread. A generator with a fixture for
several tests becomes two tests, because the launch ends only after the first parts of all.
"""

import inspect
from collections.abc import Generator, Iterator
from typing import Any

import pytest

from bus_launch.launch_pytest.fixture import LaunchOptions, options_of
from bus_launch.launch_pytest.run import LaunchRun

__all__ = [
    "event_loop",
    "launch_context",
    "launch_service",
    "pytest_collection_modifyitems",
    "pytest_configure",
    "pytest_fixture_setup",
    "pytest_pycollect_makeitem",
    "pytest_pyfunc_call",
]

_MARK = "launch"
_MISSING = '"fixture" keyword argument is required in a pytest.mark.launch() decorator'
_runs: dict[int, LaunchRun] = {}
"""Launches by the id of their fixture's value, which pytest keeps until the launch has ended."""
_first_part = pytest.StashKey[pytest.Item]()
"""In the second part of a generator: the item of the first part."""
_generator = pytest.StashKey[Any]()
"""In the first part: the generator, waiting at its `yield`."""


def pytest_configure(config: pytest.Config) -> None:
    config.addinivalue_line("markers", f"{_MARK}(fixture, shutdown): a test during a launch, or after it")


@pytest.hookimpl(wrapper=True, tryfirst=True)
def pytest_fixture_setup(fixturedef: Any, request: pytest.FixtureRequest) -> Generator[None, Any, Any]:
    """Start the launch of a fixture; it ends with the fixture."""
    options = options_of(fixturedef.func)
    made = yield
    if options is None:
        return made
    run = LaunchRun(options)
    _runs[id(made)] = run

    def close() -> None:
        del _runs[id(made)]
        run.close()

    fixturedef.addfinalizer(close)
    run.start(made)
    return made


@pytest.hookimpl(tryfirst=True)
def pytest_pycollect_makeitem(
    collector: pytest.Module | pytest.Class, name: str, obj: object
) -> list[pytest.Item] | None:
    """The items of a launch test: also for coroutines and generators, which pytest itself does not run."""
    if not collector.funcnamefilter(name) or not inspect.isfunction(obj):
        return None
    mark = pytest.Function.from_parent(collector, name=name).get_closest_marker(_MARK)
    if mark is None:
        return None
    options = options_of(mark.kwargs.get("fixture"))
    if options is None:
        item = pytest.Function.from_parent(collector, name=name, callobj=lambda: None)
        item.warn(pytest.PytestWarning(f"{item.nodeid}: {_MISSING}"))
        item.add_marker(pytest.mark.skip(_MISSING))
        return [item]
    if "usefixtures" not in [one.name for one in getattr(obj, "pytestmark", ())]:
        pytest.mark.usefixtures(options.name)(obj)  # so that it is made for each value of the fixture
    items: list[pytest.Item] = list(collector._genfunctions(name, obj))
    if _has_parts(obj) and options.scope != "function":
        for second, first in zip(list(collector._genfunctions(name, obj)), tuple(items), strict=True):
            second.name = f"{second.name}[shutdown_test]"
            second.stash[_first_part] = first
            items.append(second)
    return items


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put tests after a launch behind all tests of the same launch."""
    last = {_launch_of(item): number for number, item in enumerate(items) if not _is_after(item)}
    held: dict[Any, list[pytest.Item]] = {}
    ordered = []
    for number, item in enumerate(items):
        key = _launch_of(item)
        if key is not None and _is_after(item) and last.get(key, -1) > number:
            held.setdefault(key, []).append(item)
            continue
        ordered.append(item)
        if key is not None and last.get(key) == number:
            ordered += held.pop(key, [])
    items[:] = ordered


@pytest.hookimpl(tryfirst=True)
def pytest_pyfunc_call(pyfuncitem: pytest.Function) -> bool | None:
    """Run a launch test."""
    options = _options(pyfuncitem)
    if options is None:
        return None
    run = _runs[id(pyfuncitem.funcargs[options.name])]
    given = {name: pyfuncitem.funcargs[name] for name in pyfuncitem._fixtureinfo.argnames}
    test = pyfuncitem.obj
    is_marked = _marked_after(pyfuncitem)
    if not _has_parts(test):
        if is_marked:
            run.stop()
        if inspect.iscoroutinefunction(test):
            run.run(test(**given))
        else:
            run.call(lambda: test(**given))
        return True
    if is_marked:
        pytest.fail(
            "generator or async generator based launch test items cannot be marked with shutdown=True",
            pytrace=False,
        )
    first = pyfuncitem.stash.get(_first_part, None)
    if first is None:
        generator = test(**given)
        if not _advance(run, generator):
            pyfuncitem.stash[_generator] = generator
        if options.scope == "function":
            run.stop()
            _finish(run, pyfuncitem)
        return True
    if _generator not in first.stash:
        pytest.skip("shutdown test skipped because the test failed before")
    run.stop()
    _finish(run, first)
    return True


@pytest.fixture
def launch_service(request: pytest.FixtureRequest) -> Any:
    """The LaunchService of the test's launch."""
    return _run_of(request).service


@pytest.fixture
def launch_context(request: pytest.FixtureRequest) -> Any:
    """The LaunchContext of the test's launch."""
    return _run_of(request).service.context


@pytest.fixture
def event_loop(request: pytest.FixtureRequest) -> Iterator[Any]:
    """The event loop of the test's launch."""
    yield _run_of(request).loop


def _run_of(request: pytest.FixtureRequest) -> LaunchRun:
    options = _options(request.node)
    if options is None:
        pytest.fail(
            f"'{request.fixturename}' needs a test with @pytest.mark.launch(fixture=...)", pytrace=False
        )
    return _runs[id(request.getfixturevalue(options.name))]


def _finish(run: LaunchRun, item: pytest.Item) -> None:
    """Run the second part of a generator. One that ended in its first part has none."""
    generator = item.stash.get(_generator, None)
    if generator is not None and not _advance(run, generator):
        pytest.fail("launch tests using a generator must stop iteration after yielding once", pytrace=False)


def _advance(run: LaunchRun, generator: Any) -> bool:
    """Run a generator to its next `yield`, or to its end; returns whether it has ended."""
    end = object()
    if inspect.isasyncgen(generator):

        async def advance() -> object:
            return await anext(generator, end)

        return run.run(advance()) is end
    return run.call(lambda: next(generator, end)) is end


def _has_parts(test: object) -> bool:
    return inspect.isgeneratorfunction(test) or inspect.isasyncgenfunction(test)


def _options(item: pytest.Item) -> LaunchOptions | None:
    mark = item.get_closest_marker(_MARK)
    return None if mark is None else options_of(mark.kwargs.get("fixture"))


def _marked_after(item: pytest.Item) -> bool:
    mark = item.get_closest_marker(_MARK)
    return mark is not None and bool(mark.kwargs.get("shutdown", False))


def _is_after(item: pytest.Item) -> bool:
    return _first_part in item.stash or _marked_after(item)


def _launch_of(item: pytest.Item) -> Any:
    """A key for the launch that an item shares with others; None if it has its own or none."""
    options = _options(item)
    if options is None or options.scope == "function":
        return None
    kinds: dict[str, Any] = {"class": pytest.Class, "module": pytest.Module, "package": pytest.Package}
    place = item.getparent(kinds[options.scope]) if options.scope in kinds else None
    call = getattr(item, "callspec", None)
    row = None if call is None else call.indices.get(options.name)
    return options.name, None if place is None else place.nodeid, row
