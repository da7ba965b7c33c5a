"""Runs several coroutines at once."""

import asyncio
from collections.abc import Coroutine, Iterable
from typing import Any, TypeVar

__all__ = ["together", "until_one_ends"]

T = TypeVar("T")


async def together(coroutines: Iterable[Coroutine[Any, Any, T]]) -> list[T]:
    """Run all coroutines concurrently to their ends, begun in this order; returns their results in this
    order.

    Raises the first error in this order, when all have ended. Cancellation: all are cancelled.
    """
    results = await asyncio.gather(*coroutines, return_exceptions=True)
    for result in results:
        if isinstance(result, BaseException):
            raise result
    return results  # type: ignore[return-value]


async def until_one_ends(*coroutines: Coroutine[Any, Any, object]) -> None:
    """Run all coroutines concurrently until one of them ends; then the others are cancelled and awaited.

    Raises the error of the coroutine that ended. Cancellation: all are cancelled.
    """
    tasks = [asyncio.ensure_future(one) for one in coroutines]
    try:
        done, _ = await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in done:
            task.result()
    finally:
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
