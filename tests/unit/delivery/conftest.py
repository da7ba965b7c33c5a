"""What tests of delivery leave open is closed: to look for it takes longer than most of them."""

from collections.abc import Iterator

import pytest

from client_world import ClientWorld


@pytest.fixture(autouse=True)
def worlds_end() -> Iterator[None]:
    yield
    while ClientWorld.all_open:
        ClientWorld.all_open.pop().close()
