"""A menu of markers: entries, their check boxes and their callbacks."""

import sys
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final

from bus_ros.rosidl import message_class

if TYPE_CHECKING:
    from bus_ros.interactive_markers.interactive_marker_server import InteractiveMarkerServer

__all__ = ["EntryContext", "MenuHandler"]

_Feedback: Any = message_class("visualization_msgs/msg/InteractiveMarkerFeedback")
_MenuEntry: Any = message_class("visualization_msgs/msg/MenuEntry")


class EntryContext:
    """An entry of a menu."""

    def __init__(self) -> None:
        self.title = ""
        self.command = ""
        self.command_type = 0
        self.sub_entries: list[int] = []
        self.visible = True
        self.check_state = 0
        self.feedback_cb: Callable[[Any], object] | None = None


class MenuHandler:
    """A menu that can be applied to markers; each entry has a number, its handle."""

    NO_CHECKBOX: Final = 0
    CHECKED: Final = 1
    UNCHECKED: Final = 2

    def __init__(self) -> None:
        self.top_level_handles_: list[int] = []
        self.entry_contexts_: dict[int, EntryContext] = {}
        self.current_handle_ = 1
        self.managed_markers_: set[str] = set()

    def insert(
        self,
        title: str,
        parent: int | None = None,
        command_type: int = _MenuEntry.FEEDBACK,
        command: str = "",
        callback: Callable[[Any], object] | None = None,
    ) -> int | None:
        """Add an entry, below the entry `parent` if given; returns its handle.

        Returns None if there is no such parent.
        """
        handle = self.doInsert(title, command_type, command, callback)
        if parent is None:
            self.top_level_handles_.append(handle)
        elif parent in self.entry_contexts_:
            self.entry_contexts_[parent].sub_entries.append(handle)
        else:
            print(f"Parent menu entry '{parent}' not found", file=sys.stderr)
            return None
        return handle

    def setVisible(self, handle: int, visible: bool) -> bool:
        """Show or hide an entry; returns whether it exists."""
        entry = self.entry_contexts_.get(handle)
        if entry is not None:
            entry.visible = visible
        return entry is not None

    def setCheckState(self, handle: int, check_state: int) -> bool:
        """Set an entry to NO_CHECKBOX, CHECKED or UNCHECKED; returns whether it exists."""
        entry = self.entry_contexts_.get(handle)
        if entry is not None:
            entry.check_state = check_state
        return entry is not None

    def getCheckState(self, handle: int) -> int | None:
        """NO_CHECKBOX, CHECKED or UNCHECKED; None if there is no such entry."""
        entry = self.entry_contexts_.get(handle)
        return None if entry is None else entry.check_state

    def getTitle(self, handle: int) -> str | None:
        """The entry's title; None if there is no such entry."""
        entry = self.entry_contexts_.get(handle)
        return None if entry is None else entry.title

    def apply(self, server: "InteractiveMarkerServer", marker_name: str) -> bool:
        """Give a marker this menu, as it is now; returns whether the marker exists.

        As with other changes, clients learn of it from the server's next `applyChanges`.
        """
        marker = server.get(marker_name)
        if marker is None:
            self.managed_markers_.discard(marker_name)
            return False
        entries: list[Any] = []
        self.pushMenuEntries(self.top_level_handles_, entries, 0)
        marker.menu_entries = entries
        server.insert(marker, feedback_callback=self.processFeedback, feedback_type=_Feedback.MENU_SELECT)
        self.managed_markers_.add(marker_name)
        return True

    def reApply(self, server: "InteractiveMarkerServer") -> bool:
        """Apply again to all markers that have this menu; returns whether all of them exist."""
        applied = [self.apply(server, name) for name in list(self.managed_markers_)]
        return all(applied)

    def processFeedback(self, feedback: Any) -> None:
        """Call the callback of the selected entry."""
        entry = self.entry_contexts_.get(feedback.menu_entry_id)
        if entry is not None and entry.feedback_cb is not None:
            entry.feedback_cb(feedback)

    # --- inside, named as in ROS 2

    def pushMenuEntries(self, handles_in: Iterable[int], entries_out: list[Any], parent_handle: int) -> bool:
        """Append a message for each visible entry: first the entry, then those below it."""
        for handle in handles_in:
            entry = self.entry_contexts_.get(handle)
            if entry is None:
                print(
                    "Internal error: context handle not found! This is a bug in MenuHandler.", file=sys.stderr
                )
                return False
            if entry.visible:
                entries_out.append(self.makeEntry(entry, handle, parent_handle))
                if not self.pushMenuEntries(entry.sub_entries, entries_out, handle):
                    return False
        return True

    def makeEntry(self, context: EntryContext, handle: int, parent_handle: int) -> Any:
        """The message of an entry."""
        box = {self.CHECKED: "[x] ", self.UNCHECKED: "[ ] "}.get(context.check_state, "")
        return _MenuEntry(
            id=handle,
            parent_id=parent_handle,
            title=box + context.title,
            command=context.command,
            command_type=context.command_type,
        )

    def doInsert(
        self, title: str, command_type: int, command: str, feedback_cb: Callable[[Any], object] | None
    ) -> int:
        """Add an entry that has no place in the menu yet."""
        entry = EntryContext()
        entry.title = title
        entry.command_type = command_type
        entry.command = command
        entry.feedback_cb = feedback_cb
        handle = self.current_handle_
        self.current_handle_ += 1
        self.entry_contexts_[handle] = entry
        return handle
