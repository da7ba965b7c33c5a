"""Network interfaces that a user names. The test reads those of this machine, and sends nothing."""

import subprocess
import sys

import pytest

from bus_bridge.dds.interfaces import check_interface, is_address
from bus_bridge.errors import BridgeError
from netns import Machines, why_not
from rows import for_each


@for_each(
    ("text", "is_one"),
    [("10.0.0.1", True), ("fd00::2", True), ("eth0", False), ("10.0.0", False), ("", False)],
)
def test_an_address_is_no_name(text: str, is_one: bool) -> None:
    assert is_address(text) == is_one


@for_each("interface", ["lo", "127.0.0.1"])
def test_what_is_there(interface: str) -> None:
    check_interface(interface)


@for_each(
    ("interface", "said"),
    [
        ("nope0", "--interface nope0: there is no such network interface; there are .*lo"),
        ("192.0.2", "--interface 192.0.2: there is no such network interface"),
        ("192.0.2.7", "--interface 192.0.2.7: no network interface of this machine has that address"),
        ("2001:db8::7", "no network interface of this machine has that address"),
    ],
)
def test_what_is_not_there(interface: str, said: str) -> None:
    with pytest.raises(BridgeError, match=said):
        check_interface(interface)


@pytest.mark.skipif(bool(why_not()), reason=why_not())
@for_each(
    ("words", "said"),
    [
        (("link", "set", "eth0", "down"), "--interface eth0: that network interface is down"),
        (("address", "flush", "dev", "eth0"), "--interface eth0: that network interface has no IPv4 address"),
    ],
)
def test_what_can_not_be_used(words: tuple[str, ...], said: str) -> None:
    with Machines("robot", "laptop") as machines:
        machines.connect("robot", "laptop")
        machines["robot"].run("ip", *words)
        script = "from bus_bridge.dds.interfaces import check_interface; check_interface('eth0')"
        done = subprocess.run(
            [*machines["robot"].prefix, sys.executable, "-c", script],
            capture_output=True,
            text=True,
            timeout=30,
        )
        assert said in done.stderr
