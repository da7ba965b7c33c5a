"""The window, on a tkinter that only takes notes."""

import sys
from types import SimpleNamespace
from typing import Any
from unittest.mock import MagicMock

import pytest

from bus_turtlesim.window import NoWindow, Window, outline
from bus_turtlesim.world import SIZE, World

BLUE = (0x45, 0x56, 0xFF)


class TclError(Exception):
    pass


@pytest.fixture
def tkinter(monkeypatch: pytest.MonkeyPatch) -> Any:
    made = SimpleNamespace(Tk=MagicMock(), Canvas=MagicMock(), PhotoImage=MagicMock(), TclError=TclError)
    monkeypatch.setitem(sys.modules, "tkinter", made)
    return made


def test_it_shows_what_is_new(tkinter: Any) -> None:
    window, world = Window(), World()
    image, area = tkinter.PhotoImage.return_value, tkinter.Canvas.return_value
    turtle = world.turtles[world.spawn(5.0, 5.0, 0.0, 0)]
    window.show(world, BLUE)
    area.configure.assert_called_with(background="#4556ff")
    assert area.create_polygon.call_count == 1
    image.put.assert_not_called()
    turtle.jump(1.0, 0.0)
    window.show(world, BLUE)
    image.put.assert_called_with("#b3b8ff", to=(269, 273, 272, 276))
    image.put.reset_mock()
    window.show(world, BLUE)
    image.put.assert_not_called()
    image.blank.assert_not_called()
    world.canvas.clear()
    window.show(world, BLUE)
    image.blank.assert_called_once_with()


def test_a_turtle_looks_where_it_goes() -> None:
    world = World()
    world.spawn(SIZE / 2, SIZE / 2, 0.0, 0)
    points = outline(world.turtles["turtle1"])
    assert points[:2] == pytest.approx((249.5 + 22.5, 249.5))


def test_its_user_closes_it(tkinter: Any) -> None:
    window = Window()
    name, close = tkinter.Tk.return_value.protocol.call_args.args
    assert (name, window.is_closed) == ("WM_DELETE_WINDOW", False)
    close()
    assert window.is_closed


def test_there_is_none_without_a_display(tkinter: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    tkinter.Tk.side_effect = TclError("no display name and no $DISPLAY environment variable")
    with pytest.raises(NoWindow, match=r"^no display name"):
        Window()
    monkeypatch.setitem(sys.modules, "tkinter", None)
    with pytest.raises(NoWindow, match=r"this Python has no tkinter"):
        Window()
