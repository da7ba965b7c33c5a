"""A pending seek."""

import asyncio

__all__ = ["Seek"]


class Seek:
    """A seek to `target`, a time of the bag. Further seeks may change it before it is done; all get the same
    answer."""

    def __init__(self, target: int) -> None:
        self.target = target
        self._waiting: list[asyncio.Future[bool]] = []

    async def wait(self) -> bool:
        """Wait until it is done; returns whether the replay continues there."""
        arrived: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._waiting.append(arrived)
        return await arrived

    def end(self, *, is_there: bool) -> None:
        """End it as done or as impossible."""
        for arrived in self._waiting:
            if not arrived.done():
                arrived.set_result(is_there)
