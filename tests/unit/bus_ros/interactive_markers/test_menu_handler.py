"""Menus of markers: handles, the messages of entries, callbacks."""

from typing import Any

import pytest

from bus_ros.interactive_markers.menu_handler import MenuHandler
from bus_ros.rosidl import message_class
from rows import for_each

Feedback: Any = message_class("visualization_msgs/msg/InteractiveMarkerFeedback")
Marker: Any = message_class("visualization_msgs/msg/InteractiveMarker")
MenuEntry: Any = message_class("visualization_msgs/msg/MenuEntry")


class Server:
    """The part of a server that menus use."""

    def __init__(self, *names: str) -> None:
        self.markers = {name: Marker(name=name) for name in names}
        self.inserted: list[tuple[str, Any, int]] = []

    def get(self, name: str) -> Any:
        return self.markers.get(name)

    def insert(self, marker: Any, *, feedback_callback: Any, feedback_type: int) -> None:
        self.inserted.append((marker.name, feedback_callback, feedback_type))


def entries(menu: MenuHandler) -> list[tuple[int, int, str]]:
    """Handle, parent and title of each entry, as a marker gets them."""
    server: Any = Server("box")
    assert menu.apply(server, "box")
    return [(one.id, one.parent_id, one.title) for one in server.markers["box"].menu_entries]


def select(menu: MenuHandler, handle: int) -> None:
    menu.processFeedback(Feedback(menu_entry_id=handle))


def test_a_tree_is_sent_from_top_to_bottom() -> None:
    menu = MenuHandler()
    first, second = menu.insert("first"), menu.insert("second")
    assert (first, second) == (1, 2)
    below = menu.insert("below", parent=first)
    deepest = menu.insert("deepest", parent=below)
    assert entries(menu) == [(1, 0, "first"), (3, 1, "below"), (4, 3, "deepest"), (2, 0, "second")]
    assert below is not None
    assert menu.setVisible(below, False)
    assert entries(menu) == [(1, 0, "first"), (2, 0, "second")]
    assert menu.getTitle(4) == "deepest"
    assert deepest == 4


def test_an_unknown_parent(capsys: pytest.CaptureFixture[str]) -> None:
    menu = MenuHandler()
    assert menu.insert("lost", parent=7) is None
    assert capsys.readouterr().err == "Parent menu entry '7' not found\n"
    assert entries(menu) == []


@for_each(
    ("state", "title"),
    [(MenuHandler.NO_CHECKBOX, "go"), (MenuHandler.CHECKED, "[x] go"), (MenuHandler.UNCHECKED, "[ ] go")],
)
def test_check_boxes(state: int, title: str) -> None:
    menu = MenuHandler()
    handle = menu.insert("go")
    assert handle is not None
    assert menu.getCheckState(handle) == MenuHandler.NO_CHECKBOX
    assert menu.setCheckState(handle, state)
    assert menu.getCheckState(handle) == state
    assert entries(menu) == [(handle, 0, title)]
    assert menu.getTitle(handle) == "go"


def test_unknown_handles() -> None:
    menu = MenuHandler()
    assert not menu.setVisible(5, True)
    assert not menu.setCheckState(5, MenuHandler.CHECKED)
    assert menu.getCheckState(5) is None
    assert menu.getTitle(5) is None
    select(menu, 5)


def test_a_selected_entry_calls_its_callback() -> None:
    menu = MenuHandler()
    heard: list[int] = []
    loud = menu.insert("loud", callback=lambda feedback: heard.append(feedback.menu_entry_id))
    silent = menu.insert("silent", command_type=MenuEntry.ROSRUN, command="demo talker")
    assert loud is not None
    assert silent is not None
    select(menu, silent)
    select(menu, loud)
    assert heard == [loud]
    server: Any = Server("box")
    menu.apply(server, "box")
    sent = server.markers["box"].menu_entries
    assert [(one.command, one.command_type) for one in sent] == [
        ("", MenuEntry.FEEDBACK),
        ("demo talker", MenuEntry.ROSRUN),
    ]


def test_apply_and_apply_again() -> None:
    menu = MenuHandler()
    menu.insert("go")
    server: Any = Server("box", "ball")
    assert menu.apply(server, "box")
    assert menu.apply(server, "ball")
    assert not menu.apply(server, "none")
    assert server.inserted == [(name, menu.processFeedback, Feedback.MENU_SELECT) for name in ("box", "ball")]
    assert menu.reApply(server)
    assert len(server.inserted) == 4
    del server.markers["box"]
    assert not menu.reApply(server)
    assert menu.reApply(server)
    assert [name for name, *_ in server.inserted[4:]] == ["ball", "ball"]
