"""Marks for tests in a client world: once by each route, or only by shared memory."""

import pytest

from bus import shm

by_shared_memory = pytest.mark.skipif(not shm.is_available(), reason=shm.why_not())
by_either = pytest.mark.parametrize(
    "route",
    [pytest.param("socket", id="socket"), pytest.param("shm", id="memory", marks=by_shared_memory)],
)
