"""Work that goes on beside a client's other requests, such as calls of services; its number is bounded."""

import asyncio
from collections.abc import Coroutine
from typing import Any, Final

__all__ = ["Tasks"]

_MOST: Final = 64
"""Calls and questions for parameters of one client that may be under way."""
_MOST_BYTES: Final = 32 << 20
"""Bytes of their requests; a single request may be larger."""


class Tasks:
    """The tasks of one client, each with the bytes of its request."""

    def __init__(self) -> None:
        self._sizes: dict[asyncio.Task[None], int] = {}

    def begin(self, work: Coroutine[Any, Any, None], size: int = 0) -> bool:
        """Run `work`, whose request has `size` bytes; returns False and closes `work` if there is no room."""
        is_large = self._sizes and sum(self._sizes.values()) + size > _MOST_BYTES
        if len(self._sizes) >= _MOST or is_large:
            work.close()
            return False
        task = asyncio.get_running_loop().create_task(work)
        self._sizes[task] = size
        task.add_done_callback(self._sizes.pop)
        return True

    async def cancel(self) -> None:
        """Cancel all, and wait for their ends."""
        tasks = tuple(self._sizes)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
