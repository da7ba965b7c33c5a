"""bus_cli.metrics.place: which places may be named."""

import re
from argparse import ArgumentTypeError

import pytest

from bus_cli.metrics.place import Place, parse_place
from rows import for_each


@for_each(
    ("text", "expected"),
    [
        ("127.0.0.1:9464", Place("127.0.0.1", 9464)),
        ("127.0.0.2:0", Place("127.0.0.2", 0)),
        ("localhost:9464", Place("127.0.0.1", 9464)),
        ("[::1]:65535", Place("::1", 65535)),
    ],
)
def test_places(text: str, expected: Place) -> None:
    assert parse_place(text) == expected


@for_each(
    ("text", "reason"),
    [
        ("0.0.0.0:9464", "0.0.0.0 is not loopback; metrics name processes and topics"),
        ("192.168.1.7:9464", "is not loopback"),
        ("[::]:9464", "is not loopback"),
        (":9464", "'' is no address"),
        ("example.org:9464", "'example.org' is no address"),
        ("9464", "is not address:port"),
        ("127.0.0.1", "is not address:port"),
        ("127.0.0.1:http", "is not address:port"),
        ("127.0.0.1:65536", "is not address:port"),
        ("127.0.0.1:99999999999999999999", "is not address:port"),
        ("unix:/run/x.sock", "is not address:port"),
    ],
)
def test_what_is_no_place(text: str, reason: str) -> None:
    with pytest.raises(ArgumentTypeError, match=re.escape(reason)):
        parse_place(text)
