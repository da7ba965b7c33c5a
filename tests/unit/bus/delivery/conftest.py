"""What tests of delivery leave open is closed: to look for it takes longer than most of them."""

from collections.abc import Iterator

import pytest

from bus.diagnostics import provoked
from client_world import ClientWorld


@pytest.fixture(autouse=True)
def worlds_end(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    monkeypatch.setattr(provoked, "_is_within_bounds", lambda *_: True)  # they are counted by event loop
    yield
    while ClientWorld.all_open:
        ClientWorld.all_open.pop().close()
