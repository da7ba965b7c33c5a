"""The checks that engines for zenoh repeat: a failed one does not end them."""

import asyncio
from typing import Any
from unittest.mock import AsyncMock, Mock

import pytest

from bus_bridge.rmw_zenoh import engine as rmw_zenoh
from bus_bridge.rmw_zenoh.engine import RmwZenohEngine
from bus_bridge.zenoh import engine as zenoh
from bus_bridge.zenoh.engine import ZenohEngine
from semantics import until


@pytest.mark.parametrize(("module", "kind"), [(zenoh, ZenohEngine), (rmw_zenoh, RmwZenohEngine)])
async def test_a_failed_check_does_not_end_the_next_ones(
    monkeypatch: pytest.MonkeyPatch, module: Any, kind: Any
) -> None:
    monkeypatch.setattr(module, "_LOOK_S", 0)
    engine = object.__new__(kind)
    check = AsyncMock(side_effect=[ZeroDivisionError("by design"), *[None] * 1000])
    engine._links, engine._far, engine._presence = Mock(check=check), Mock(), Mock()
    engine._session = Mock(link_ends=0, links=Mock(return_value=[]))
    engine._writers, engine._declared, engine._options = {}, [], Mock(router=None)
    engine._watch, engine._intakes, engine._lost_tokens = Mock(), Mock(), 0
    polling = asyncio.create_task(engine._poll())
    await until(lambda: check.await_count > 1)
    polling.cancel()
    engine._far.warn.assert_called_once_with("a check of the links failed: ZeroDivisionError: by design")
