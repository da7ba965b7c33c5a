"""Tables of values: all rows in one case of pytest; a failure still names its row."""

from collections.abc import Callable, Iterable
from functools import wraps
from inspect import signature
from reprlib import Repr
from typing import Any

import pytest

_SHORT = Repr()
_SHORT.maxstring = _SHORT.maxother = _SHORT.maxlong = 100


def for_each(
    names: str | tuple[str, ...], rows: Iterable[Any] | Callable[[], Iterable[Any]]
) -> Callable[[Callable[..., None]], Callable[..., None]]:
    """Run a test with each row, as `pytest.mark.parametrize`, but in one case and with the same fixtures.

    A function for `rows` is called when the test runs. All rows are tried. The output is the first failure,
    with its row, and a line for each other row that fails. A test that needs a separate loop, process or
    fixture for each row stays parametrized, and so does a test that skips.
    """
    if isinstance(names, str):
        names = tuple(name.strip() for name in names.split(","))

    def as_table(rows: Iterable[Any]) -> list[dict[str, Any]]:
        table = [dict(zip(names, row if len(names) > 1 else (row,), strict=True)) for row in rows]
        assert table, "a table without rows tests nothing"
        return table

    given = as_table(rows) if isinstance(rows, Iterable) else []

    def decorate(test: Callable[..., None]) -> Callable[..., None]:
        @wraps(test)
        def run(*args: Any, **kwargs: Any) -> None:
            failures: list[tuple[str, BaseException]] = []
            for row in given if isinstance(rows, Iterable) else as_table(rows()):
                try:
                    test(*args, **kwargs, **row)
                except (Exception, pytest.fail.Exception) as failure:
                    failures.append((_shown(row), failure))
                except pytest.skip.Exception:
                    raise TypeError(f"{_shown(row)} would leave out the rows behind it") from None
            if failures:
                (shown, first), *others = failures
                first.add_note(f"in the row {shown}")
                for shown, other in others:
                    text = str(other).partition("\n")[0]
                    first.add_note(f"fails too: {shown}: {type(other).__name__}: {text}")
                raise first

        whole = signature(test)
        left = [one for name, one in whole.parameters.items() if name not in names]
        assert len(left) == len(whole.parameters) - len(names), f"{test.__name__} has not all of {names}"
        run.__signature__ = whole.replace(parameters=left)  # type: ignore[attr-defined]
        return run

    return decorate


def _shown(row: dict[str, Any]) -> str:
    return ", ".join(f"{name}={_SHORT.repr(value)}" for name, value in row.items())
