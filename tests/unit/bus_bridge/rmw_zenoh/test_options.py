"""bus_bridge.rmw_zenoh.options: mistakes are found before anything is opened."""

import pytest

from bus_bridge.errors import BridgeError
from bus_bridge.rmw_zenoh.options import RmwZenohOptions, addresses_to_connect, check
from bus_bridge.zenoh.options import ZenohOptions

LOCAL = ZenohOptions(connect=addresses_to_connect((), (), ()))


def test_the_router_of_this_machine_needs_no_certificates() -> None:
    assert check(RmwZenohOptions(LOCAL, 0)) == []


def test_the_domain_of_the_environment(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("ROS_DOMAIN_ID", "7")
    assert RmwZenohOptions(LOCAL).domain == 7
    assert RmwZenohOptions(LOCAL, 3).domain == 3
    monkeypatch.setenv("ROS_DOMAIN_ID", "seven")
    with pytest.raises(BridgeError, match="ROS_DOMAIN_ID must be a number from 0 to 232, not 'seven'"):
        check(RmwZenohOptions(LOCAL))


def test_a_domain_out_of_range() -> None:
    with pytest.raises(BridgeError, match="the domain must be from 0 to 232, not 233"):
        check(RmwZenohOptions(LOCAL, 233))


def test_unprotected_addresses_are_refused() -> None:
    with pytest.raises(BridgeError, match="is not protected"):
        check(RmwZenohOptions(ZenohOptions(connect=("tcp/10.0.0.2:7447",)), 0))


def test_the_router_of_this_machine_is_used_if_nothing_is_said() -> None:
    assert addresses_to_connect((), (), ()) == ("tcp/localhost:7447",)
    assert addresses_to_connect(("tcp/[::1]:1",), (), ()) == ("tcp/[::1]:1",)
    assert addresses_to_connect((), ("tcp/127.0.0.1:0",), ()) == ()
    assert addresses_to_connect((), (), ("tcp/10.0.0.1:7447",)) == ()
