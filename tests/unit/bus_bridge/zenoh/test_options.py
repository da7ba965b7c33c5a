"""Addresses and certificates, checked before the bridge opens anything."""

from pathlib import Path

import pytest

from bus_bridge.errors import BridgeError
from bus_bridge.zenoh.options import ZenohOptions, check, parse_address
from certificates import make_certificates
from rows import for_each


@for_each(
    ("text", "is_loopback"),
    [
        ("tcp/127.0.0.1:7447", True),
        ("tls/localhost:1", True),
        ("tcp/[::1]:65535", True),
        ("quic/0.0.0.0:7447", False),
        ("tls/robot.local:7447", False),
        ("tcp/[::]:7447", False),
    ],
)
def test_addresses(text: str, is_loopback: bool) -> None:
    assert parse_address(text).is_loopback is is_loopback


@for_each(
    ("text", "why"),
    [
        ("robot:7447", "must begin with tls/, quic/ or tcp/: tls/robot:7447"),
        ("udp/robot:7447", "must begin with"),
        ("tls/robot", "must end with a host and a port"),
        ("tls/:7447", "must end with a host and a port"),
        ("tls/::1:7447", "must end with a host and a port"),
        ("tls/robot:0", "port '0'"),
        ("tls/robot:70000", "port '70000'"),
        ("tls/robot:x", "port 'x'"),
        ("tls/ro#bot:7", "has a host with an invalid character"),
    ],
)
def test_what_is_no_address(text: str, why: str) -> None:
    with pytest.raises(BridgeError) as raised:
        parse_address(text)
    assert why in str(raised.value) and text in str(raised.value)


def test_loopback_needs_nothing() -> None:
    assert check(ZenohOptions(listen=("tcp/127.0.0.1:7447",), connect=("tcp/[::1]:7447",))) == []


def test_nobody_to_reach_is_said() -> None:
    assert check(ZenohOptions()) == [
        "none of --listen, --connect and --router is given: no other bridge can be reached"
    ]


def test_other_addresses_need_protection_or_a_word() -> None:
    for options in (ZenohOptions(listen=("tcp/0.0.0.0:7447",)), ZenohOptions(connect=("tcp/robot:7447",))):
        with pytest.raises(BridgeError, match="is not protected"):
            check(options)
    (said,) = check(ZenohOptions(listen=("tcp/0.0.0.0:7447",), insecure=True))
    assert "--listen tcp/0.0.0.0:7447 is not protected" in said


def test_a_router_stands_instead_of_links_of_ones_own() -> None:
    router = ("tcp/127.0.0.1:7447",)
    assert check(ZenohOptions(router=router)) == []
    for flag, options in (
        ("--listen", ZenohOptions(router=router, listen=router)),
        ("--connect", ZenohOptions(router=router, connect=router)),
    ):
        with pytest.raises(BridgeError, match=f"^--router and {flag} can't be given together"):
            check(options)
    with pytest.raises(BridgeError, match=r"^--router tcp/base:7447 is not protected"):
        check(ZenohOptions(router=("tcp/base:7447",)))
    with pytest.raises(BridgeError, match=r"^--router tls/base:7447 needs certificates for both sides"):
        check(ZenohOptions(router=("tls/base:7447",)))


def test_protection_needs_certificates_of_both_sides() -> None:
    with pytest.raises(BridgeError, match="sides: --certificate FILE, --key FILE are missing"):
        check(ZenohOptions(listen=("tls/127.0.0.1:7447",), ca="ca.pem"))
    with pytest.raises(BridgeError, match="sides: --key FILE is missing"):
        check(ZenohOptions(listen=("tls/127.0.0.1:7447",), ca="ca.pem", certificate="robot.pem"))


def test_certificates_are_looked_at(tmp_path: Path) -> None:
    made = make_certificates(tmp_path, "robot", "laptop")
    robot, laptop = made["robot"], made["laptop"]

    def options(ca: object, certificate: object, key: object) -> ZenohOptions:
        return ZenohOptions(connect=("tls/x:1",), ca=str(ca), certificate=str(certificate), key=str(key))

    assert check(options(robot.ca, robot.certificate, robot.key)) == []
    for wrong, why in (
        (options(tmp_path / "none", robot.certificate, robot.key), "No such file"),
        (options(robot.key, robot.certificate, robot.key), "^--ca .* has no certificate in PEM"),
        (options(robot.ca, robot.key, robot.key), "^--certificate .* has no certificate in PEM"),
        (options(robot.ca, robot.certificate, laptop.key), "does not belong to"),
        (options(robot.ca, robot.certificate, robot.ca), "is not a private key"),
    ):
        with pytest.raises(BridgeError, match=why):
            check(wrong)
