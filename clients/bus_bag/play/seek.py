"""A seek that was asked for and is yet to be done."""

import asyncio

__all__ = ["Seek"]


class Seek:
    """To `target`, a time of the bag. Further seeks may change it meanwhile; all are answered at once."""

    def __init__(self, target: int) -> None:
        self.target = target
        self._waiting: list[asyncio.Future[bool]] = []

    async def wait(self) -> bool:
        """Until it is done; returns whether the replay goes on from there."""
        arrived: asyncio.Future[bool] = asyncio.get_running_loop().create_future()
        self._waiting.append(arrived)
        return await arrived

    def end(self, *, is_there: bool) -> None:
        """It is done, or can't be done."""
        for arrived in self._waiting:
            if not arrived.done():
                arrived.set_result(is_there)
