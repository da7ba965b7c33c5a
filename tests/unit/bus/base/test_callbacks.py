"""Properties of a callback, as `inspect` reports them. busd reads those of a plain function from its code."""

from collections.abc import Callable
from functools import partial, wraps
from inspect import Parameter, Signature, iscoroutinefunction, signature
from typing import Any

import pytest

from bus.base.callbacks import is_async, refuse_coroutine, takes, takes_info
from rows import for_each


class Station:
    def one(self, message: object) -> None: ...

    def two(self, message: object, info: object) -> None: ...

    def own(self, message: object, count: int = 0) -> None: ...

    async def later(self, message: object) -> None: ...

    @staticmethod
    def still(message: object, info: object) -> None: ...

    @classmethod
    def of_class(cls, message: object, info: object) -> None: ...

    def __call__(self, message: object, info: object) -> None: ...


class Waits:
    async def __call__(self, message: object) -> None: ...


def many(*arguments: object) -> None: ...


def first(message: object, /, info: object) -> None: ...


def named(message: object, *, info: object) -> None: ...


def defaults(message: object, info: object = None, other: object = None) -> None: ...


async def later(message: object, info: object) -> None: ...


def strict(message: object, *, wanted: object) -> None: ...


def lenient(*messages: object, wanted: object = None) -> None: ...


def wrapped(callback: Callable[..., object]) -> Callable[..., object]:
    @wraps(callback)
    def call(*arguments: object) -> object:
        return callback(*arguments)

    return call


def with_signature() -> Callable[..., object]:
    def call(*arguments: object) -> None: ...

    parameters = [Parameter(name, Parameter.POSITIONAL_ONLY) for name in ("message", "info")]
    call.__signature__ = Signature(parameters)  # type: ignore[attr-defined]
    return call


STATION = Station()
PLAIN: list[Callable[..., Any]] = [
    many,
    first,
    named,
    strict,
    lenient,
    defaults,
    later,
    lambda message: None,
    lambda message, info: None,
    lambda message, mine=STATION: None,
    STATION.one,
    STATION.two,
    STATION.own,
    STATION.later,
    Station.still,
    Station.of_class,
    Station.two,
    [].append,
]


@for_each("callback", [*PLAIN, wrapped(later), wrapped(STATION.one), with_signature(), STATION])
def test_it_is_as_inspect_says(callback: Callable[..., Any]) -> None:
    asked = [
        one
        for one in signature(callback).parameters.values()
        if one.kind in (Parameter.POSITIONAL_ONLY, Parameter.POSITIONAL_OR_KEYWORD)
        and one.default is Parameter.empty
    ]
    assert takes_info(callback) is (len(asked) >= 2)
    assert is_async(callback) is iscoroutinefunction(callback)
    for count in range(4):
        assert takes(callback, count) is _can_be_bound(callback, count)


def _can_be_bound(callback: Callable[..., Any], count: int) -> bool:
    try:
        signature(callback).bind(*(None,) * count)
    except TypeError:
        return False
    return True


def test_parts_of_functions() -> None:
    assert takes_info(partial(STATION.two)) and not takes_info(partial(STATION.two, None))
    assert is_async(partial(later)) and not is_async(partial(first))


def test_objects_that_are_called() -> None:
    assert is_async(Waits()) and not is_async(STATION)
    assert takes_info(STATION) and not takes_info(Waits())


async def work() -> None: ...


def test_a_coroutine_of_a_callback_that_is_not_async() -> None:
    def outer() -> Callable[[], object]:
        return lambda: work()

    callback = outer()
    line = callback.__code__.co_firstlineno
    with pytest.raises(TypeError) as caught:
        refuse_coroutine(partial(callback), callback())
    assert str(caught.value) == (
        f"callback {outer.__qualname__}.<locals>.<lambda> ({__name__}:{line}) returned the coroutine work, "
        "which nothing would run: make the callback async def, or pass the async def itself, or "
        "functools.partial of it"
    )


def test_other_answers_of_a_callback() -> None:
    for answer in (None, 5, work, iter(())):
        refuse_coroutine(print, answer)
