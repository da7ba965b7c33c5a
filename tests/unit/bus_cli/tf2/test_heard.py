"""Completion of frames, without a bus."""

from argparse import Namespace
from unittest.mock import AsyncMock, Mock

import pytest

from bus_cli import query
from bus_cli.tf2 import heard


def test_names_with_control_characters_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(query, "get_graph", Mock())
    names = {"robot", "arm", "two\nlines", "\x1b[2J", "\u202e"}
    monkeypatch.setattr(heard, "_listen", AsyncMock(return_value=names))
    assert heard.complete_frames("", Namespace()) == ["arm", "robot"]
