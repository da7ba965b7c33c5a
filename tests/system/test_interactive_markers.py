"""interactive_markers: a server and a client of markers on the bus."""

from collections.abc import Iterator
from typing import Any

import pytest

from bus_ros.interactive_markers import InteractiveMarkerServer, MenuHandler
from bus_ros.rclpy.exceptions import InvalidHandle
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rosidl import message_class, service_class
from rclpy_world import World, arguments, world

__all__ = ["arguments", "world"]

Feedback: Any = message_class("visualization_msgs/msg/InteractiveMarkerFeedback")
GetInteractiveMarkers: Any = service_class("visualization_msgs/srv/GetInteractiveMarkers")
Header: Any = message_class("std_msgs/msg/Header")
Marker: Any = message_class("visualization_msgs/msg/InteractiveMarker")
Point: Any = message_class("geometry_msgs/msg/Point")
Pose: Any = message_class("geometry_msgs/msg/Pose")
Time: Any = message_class("builtin_interfaces/msg/Time")
Update: Any = message_class("visualization_msgs/msg/InteractiveMarkerUpdate")


def at(x: float) -> Any:
    return Pose(position=Point(x=x))


def marker(name: str, x: float = 0.0, frame: str = "map") -> Any:
    return Marker(name=name, header=Header(frame_id=frame), pose=at(x))


class Scene:
    """A server with the markers `box` and `ball`, and a client that knows both."""

    def __init__(self, world: World) -> None:
        self.world = world
        self.node, self.client = world.node("server"), world.node("client")
        self.server = InteractiveMarkerServer(self.node, "shapes")
        self.updates: list[Any] = []
        self.client.create_subscription(Update, "shapes/update", self.updates.append, 100)
        self.requests = self.client.create_client(GetInteractiveMarkers, "shapes/get_interactive_markers")
        self.feedback = self.client.create_publisher(Feedback, "shapes/feedback", 10)
        world.spin_until(
            lambda: (
                self.server.update_pub.get_subscription_count()
                and self.feedback.get_subscription_count()
                and self.requests.service_is_ready()
            )
        )
        self.server.insert(marker("box"))
        self.server.insert(marker("ball", 1.0))
        assert self.apply() == (["box", "ball"], [], [])

    def apply(self) -> tuple[list[str], list[tuple[str, float]], list[str]]:
        """Apply the changes; returns what the client learns: markers, poses, erased markers."""
        self.server.applyChanges()
        return self.next_update()

    def next_update(self) -> tuple[list[str], list[tuple[str, float]], list[str]]:
        self.world.spin_until(lambda: self.updates)
        update = self.updates.pop(0)
        assert update.type == Update.UPDATE
        assert update.seq_num == self.server.seq_num
        poses = [(one.name, one.pose.position.x) for one in update.poses]
        return [one.name for one in update.markers], poses, list(update.erases)

    def ask(self) -> tuple[int, dict[str, float]]:
        """The answer to a new client."""
        future = self.requests.call_async(GetInteractiveMarkers.Request())
        self.world.spin_until(future.done)
        answer = future.result()
        return answer.sequence_number, {one.name: one.pose.position.x for one in answer.markers}

    def dragged(self, name: str, x: float, client: str = "", **fields: Any) -> Any:
        """Feedback of a client; by default of the one to which a new marker belongs."""
        return Feedback(
            marker_name=name, event_type=Feedback.POSE_UPDATE, pose=at(x), client_id=client, **fields
        )


@pytest.fixture
def scene(world: World) -> Iterator[Scene]:
    made = Scene(world)
    yield made
    made.server.shutdown()


def test_markers_are_inserted_and_replaced(scene: Scene) -> None:
    assert scene.ask() == (1, {"box": 0.0, "ball": 1.0})
    scene.server.insert(marker("box", 5.0))
    assert scene.server.get("box").pose.position.x == 5.0
    assert scene.ask() == (1, {"box": 0.0, "ball": 1.0})
    assert scene.apply() == (["box"], [], [])
    assert scene.ask() == (2, {"box": 5.0, "ball": 1.0})


def test_nothing_is_published_without_a_change(scene: Scene) -> None:
    scene.server.applyChanges()
    assert scene.server.seq_num == 1


def test_erase_and_clear(scene: Scene) -> None:
    assert scene.server.erase("box")
    assert scene.server.get("box") is None
    assert scene.apply() == ([], [], ["box"])
    assert not scene.server.erase("box")
    scene.server.insert(marker("cone"))
    assert scene.server.erase("cone")
    assert scene.apply() == ([], [], [])
    scene.server.insert(marker("cone"))
    scene.server.clear()
    assert scene.server.get("cone") is None
    assert scene.apply() == ([], [], ["ball"])
    assert scene.ask() == (4, {})


def test_poses(scene: Scene) -> None:
    assert scene.server.setPose("box", at(2.0))
    assert scene.server.get("box").pose.position.x == 2.0
    assert scene.apply() == ([], [("box", 2.0)], [])
    assert scene.server.get("box").header.frame_id == "map"
    assert scene.server.setPose("box", at(3.0), Header(frame_id="odom"))
    assert scene.apply() == ([], [("box", 3.0)], [])
    assert scene.server.get("box").header.frame_id == "odom"
    assert not scene.server.setPose("none", at(1.0))
    scene.server.insert(marker("cone"))
    assert not scene.server.setPose("cone", at(1.0))
    scene.server.erase("cone")
    assert not scene.server.setPose("cone", at(1.0))


def test_a_client_moves_a_marker(scene: Scene) -> None:
    heard: list[tuple[str, float]] = []
    scene.server.setCallback("box", lambda one: heard.append((one.client_id, one.pose.position.x)))
    scene.feedback.publish(scene.dragged("box", 4.0))
    assert scene.next_update() == ([], [("box", 4.0)], [])
    assert heard == [("", 4.0)]
    assert scene.server.get("box").pose.position.x == 4.0


def test_a_marker_belongs_to_a_client_for_a_second(scene: Scene, monkeypatch: pytest.MonkeyPatch) -> None:
    owned = "bus_ros.interactive_markers.interactive_marker_server._OWNED_S"
    monkeypatch.setattr(owned, 1e6)
    for x, client in ((3.0, "rviz"), (4.0, ""), (5.0, "rviz")):
        scene.server.processFeedback(scene.dragged("box", x, client))
    scene.server.processFeedback(scene.dragged("none", 6.0))
    assert scene.next_update() == ([], [("box", 4.0)], [])
    assert scene.server.seq_num == 2
    monkeypatch.setattr(owned, 0.0)
    scene.server.processFeedback(scene.dragged("box", 6.0, "rviz"))
    assert scene.next_update() == ([], [("box", 6.0)], [])


def test_the_header_of_feedback_counts_for_a_stamped_marker(scene: Scene) -> None:
    scene.feedback.publish(scene.dragged("box", 4.0, header=Header(frame_id="odom")))
    scene.next_update()
    assert scene.server.get("box").header.frame_id == "map"
    stamped = marker("box")
    stamped.header.stamp = Time(sec=1)
    scene.server.insert(stamped)
    scene.apply()
    scene.feedback.publish(scene.dragged("box", 5.0, header=Header(frame_id="odom")))
    scene.next_update()
    assert scene.server.get("box").header.frame_id == "odom"


def test_callbacks_for_one_event_and_for_all(scene: Scene) -> None:
    heard: list[str] = []

    def hear(word: str) -> Any:
        return lambda feedback: heard.append(word)

    def events(*types: int) -> list[str]:
        heard.clear()
        for event in types:
            scene.server.processFeedback(Feedback(marker_name="box", event_type=event))
        return list(heard)

    server = scene.server
    assert events(Feedback.MOUSE_DOWN) == []
    server.insert(marker("box"), feedback_callback=hear("any"))
    assert server.setCallback("box", hear("down"), Feedback.MOUSE_DOWN)
    assert events(Feedback.MOUSE_DOWN, Feedback.MOUSE_UP) == ["down", "any"]
    assert server.setCallback("box", None, Feedback.MOUSE_DOWN)
    assert events(Feedback.MOUSE_DOWN) == ["any"]
    assert server.setCallback("box", None)
    assert events(Feedback.MOUSE_DOWN) == []
    assert not server.setCallback("none", hear("any"))


def test_callbacks_of_a_marker_that_waits(scene: Scene) -> None:
    heard: list[Any] = []
    scene.server.insert(marker("cone"))
    assert scene.server.setCallback("cone", heard.append, Feedback.BUTTON_CLICK)
    click = Feedback(marker_name="cone", event_type=Feedback.BUTTON_CLICK)
    scene.server.processFeedback(click)
    assert heard == []
    scene.server.applyChanges()
    scene.server.processFeedback(click)
    assert heard == [click]


def test_a_menu(scene: Scene) -> None:
    menu = MenuHandler()
    chosen: list[int] = []

    def choose(feedback: Any) -> None:
        chosen.append(feedback.menu_entry_id)
        menu.setCheckState(feedback.menu_entry_id, MenuHandler.CHECKED)
        menu.reApply(scene.server)

    handle = menu.insert("go", callback=choose)
    assert menu.apply(scene.server, "box")
    assert scene.apply() == (["box"], [], [])
    event = {"event_type": Feedback.MENU_SELECT, "menu_entry_id": handle}
    scene.feedback.publish(Feedback(marker_name="box", **event))
    assert scene.next_update() == (["box"], [], [])
    assert chosen == [handle]
    assert [one.title for one in scene.server.get("box").menu_entries] == ["[x] go"]


def test_shutdown_erases_the_markers(scene: Scene) -> None:
    scene.server.shutdown()
    assert scene.next_update() == ([], [], ["box", "ball"])
    scene.world.spin_until(lambda: not scene.feedback.get_subscription_count())
    scene.server.shutdown()


def test_qos(world: World) -> None:
    server = InteractiveMarkerServer(
        world.node("server"), "a", update_pub_qos=QoSProfile(depth=3), feedback_sub_qos=QoSProfile(depth=4)
    )
    assert (server.update_pub.qos_profile.depth, server.feedback_sub.qos_profile.depth) == (3, 4)
    default = InteractiveMarkerServer(world.node("other"), "b")
    assert (default.update_pub.qos_profile.depth, default.feedback_sub.qos_profile.depth) == (100, 1)
    default.node.destroy_node()
    default.insert(marker("box"))
    with pytest.raises(InvalidHandle):
        default.applyChanges()
