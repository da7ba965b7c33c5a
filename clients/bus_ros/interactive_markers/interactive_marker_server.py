"""A server of interactive markers: it shows them to clients, and gets their feedback."""

from collections.abc import Callable
from threading import Lock
from typing import Any, Final

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.qos import QoSProfile
from bus_ros.rclpy.time import Time
from bus_ros.rosidl import message_class, service_class

__all__ = ["InteractiveMarkerServer", "MarkerContext", "UpdateContext"]

_Feedback: Any = message_class("visualization_msgs/msg/InteractiveMarkerFeedback")
_Marker: Any = message_class("visualization_msgs/msg/InteractiveMarker")
_Pose: Any = message_class("visualization_msgs/msg/InteractiveMarkerPose")
_Update: Any = message_class("visualization_msgs/msg/InteractiveMarkerUpdate")
_GetInteractiveMarkers: Any = service_class("visualization_msgs/srv/GetInteractiveMarkers")
_NO_STAMP: Final = message_class("builtin_interfaces/msg/Time")()

_UPDATE_QOS: Final = QoSProfile(depth=100)
_FEEDBACK_QOS: Final = QoSProfile(depth=1)
_OWNED_S: Final = 1.0
"""The time after a client's feedback during which feedback of other clients is ignored."""

_Callback = Callable[[Any], object]


class _Callbacks:
    """Callbacks of a marker: one for all events, and others for one event each."""

    def __init__(self) -> None:
        self.default_feedback_callback: _Callback | None = None
        self.feedback_callbacks: dict[int, _Callback] = {}

    def set_callback(self, callback: _Callback | None, event_type: int) -> None:
        if event_type == InteractiveMarkerServer.DEFAULT_FEEDBACK_CALLBACK:
            self.default_feedback_callback = callback
        elif callback is not None:
            self.feedback_callbacks[event_type] = callback
        else:
            self.feedback_callbacks.pop(event_type, None)


class MarkerContext(_Callbacks):
    """A marker that clients know."""

    def __init__(self, time: Time) -> None:
        super().__init__()
        self.last_feedback = time
        self.last_client_id = ""
        self.int_marker = _Marker()


class UpdateContext(_Callbacks):
    """A change of a marker that clients do not know yet."""

    FULL_UPDATE: Final = 0
    POSE_UPDATE: Final = 1
    ERASE: Final = 2

    def __init__(self, update_type: int = FULL_UPDATE) -> None:
        super().__init__()
        self.update_type = update_type
        self.int_marker = _Marker()


class InteractiveMarkerServer:
    """Markers in a namespace, which clients such as RViz show.

    Changes (`insert`, `setPose`, `erase`, `clear`) reach the clients with the next `applyChanges`. Feedback
    of clients moves markers, and calls callbacks.
    """

    DEFAULT_FEEDBACK_CALLBACK: Final = 255
    """The type of feedback that stands for all types without a callback."""

    def __init__(
        self,
        node: Node,
        namespace: str,
        *,
        update_pub_qos: QoSProfile = _UPDATE_QOS,
        feedback_sub_qos: QoSProfile = _FEEDBACK_QOS,
    ) -> None:
        self.node = node
        self.namespace = namespace
        self.seq_num = 0
        self.mutex = Lock()
        self.marker_contexts: dict[str, MarkerContext] = {}
        self.pending_updates: dict[str, UpdateContext] = {}
        self.get_interactive_markers_srv: Any = node.create_service(
            _GetInteractiveMarkers, f"{namespace}/get_interactive_markers", self.getInteractiveMarkersCallback
        )
        self.update_pub: Any = node.create_publisher(_Update, f"{namespace}/update", update_pub_qos)
        self.feedback_sub: Any = node.create_subscription(
            _Feedback, f"{namespace}/feedback", self.processFeedback, feedback_sub_qos
        )

    def shutdown(self) -> None:
        """Erase all markers, and leave the graph. Call it before the node is destroyed."""
        if self.node.context.ok() and self.update_pub is not None:
            self.clear()
            self.applyChanges()
        if self.get_interactive_markers_srv is not None:
            self.node.destroy_service(self.get_interactive_markers_srv)
            self.get_interactive_markers_srv = None
        if self.update_pub is not None:
            self.node.destroy_publisher(self.update_pub)
            self.update_pub = None
        if self.feedback_sub is not None:
            self.node.destroy_subscription(self.feedback_sub)
            self.feedback_sub = None

    def insert(
        self,
        marker: Any,
        *,
        feedback_callback: _Callback | None = None,
        feedback_type: int = DEFAULT_FEEDBACK_CALLBACK,
    ) -> None:
        """Add a marker, or replace the one with its name. A callback applies at once."""
        with self.mutex:
            update = self.pending_updates.setdefault(marker.name, UpdateContext())
            update.update_type = UpdateContext.FULL_UPDATE
            update.int_marker = marker
        if feedback_callback is not None:
            self.setCallback(marker.name, feedback_callback, feedback_type)

    def setPose(self, name: str, pose: Any, header: Any = None) -> bool:
        """Move a marker; without a header, or if its frame is empty, the marker keeps its header.

        Returns False if there is no such marker, or if it waits to be inserted.
        """
        with self.mutex:
            known = self.marker_contexts.get(name)
            update = self.pending_updates.get(name)
            if known is None or (update is not None and update.update_type == UpdateContext.FULL_UPDATE):
                return False
            keeps_header = header is None or not header.frame_id
            self.doSetPose(update, name, pose, known.int_marker.header if keeps_header else header)
            return True

    def erase(self, name: str) -> bool:
        """Remove a marker; returns whether it exists."""
        with self.mutex:
            return self._erase(name)

    def clear(self) -> None:
        """Remove all markers, and forget changes that clients do not know."""
        with self.mutex:
            self.pending_updates = {}
            for name in self.marker_contexts:
                self._erase(name)

    def setCallback(
        self,
        name: str,
        feedback_callback: _Callback | None,
        feedback_type: int = DEFAULT_FEEDBACK_CALLBACK,
    ) -> bool:
        """Set the callback for a type of feedback, or for all other types; None removes it.

        Returns False if there is no such marker. It applies at once.
        """
        with self.mutex:
            found = [self.marker_contexts.get(name), self.pending_updates.get(name)]
            owners = [one for one in found if one is not None]
            for owner in owners:
                owner.set_callback(feedback_callback, feedback_type)
            return bool(owners)

    def applyChanges(self) -> None:
        """Publish the changes since the last call; without a change, publish nothing."""
        with self.mutex:
            if not self.pending_updates:
                return
            message = _Update(type=_Update.UPDATE)
            for name, update in self.pending_updates.items():
                self._apply(name, update, message)
            self.pending_updates = {}
            self.seq_num += 1
            self.publish(message)

    def get(self, name: str) -> Any:
        """The marker with its pending changes; None if there is none, or if it waits to be erased."""
        with self.mutex:
            known = self.marker_contexts.get(name)
            update = self.pending_updates.get(name)
            if update is None:
                return known and known.int_marker
            if update.update_type == UpdateContext.FULL_UPDATE:
                return update.int_marker
            if known is None or update.update_type == UpdateContext.ERASE:
                return None
            known.int_marker.pose = update.int_marker.pose
            return known.int_marker

    def processFeedback(self, feedback: Any) -> None:
        """Move the marker, call the callback for this feedback, and publish the changes."""
        with self.mutex:
            known = self.marker_contexts.get(feedback.marker_name)
            if known is None or not self._is_first_client(known, feedback):
                return
            known.last_feedback = self.node.get_clock().now()
            known.last_client_id = feedback.client_id
            if feedback.event_type == _Feedback.POSE_UPDATE:
                keeps_header = known.int_marker.header.stamp == _NO_STAMP
                header = known.int_marker.header if keeps_header else feedback.header
                update = self.pending_updates.get(feedback.marker_name)
                self.doSetPose(update, feedback.marker_name, feedback.pose, header)
        callback = known.feedback_callbacks.get(feedback.event_type, known.default_feedback_callback)
        if callback is not None:
            callback(feedback)
        self.applyChanges()

    # --- inside; public names are those of ROS 2

    def publish(self, update: Any) -> None:
        """Publish an update with its number."""
        update.seq_num = self.seq_num
        self.update_pub.publish(update)

    def getInteractiveMarkersCallback(self, request: Any, response: Any) -> Any:
        """Answer a new client: all markers that clients know."""
        with self.mutex:
            response.sequence_number = self.seq_num
            response.markers = [one.int_marker for one in self.marker_contexts.values()]
            names = "".join(f"\n    {name}" for name in self.marker_contexts)
        logger = self.node.get_logger()
        logger.debug(f"Markers requested. Responding with the following markers:{names}")
        return response

    def doSetPose(self, update: UpdateContext | None, name: str, pose: Any, header: Any) -> None:
        """Note a new pose. The caller holds the lock."""
        if update is None:
            update = self.pending_updates[name] = UpdateContext(UpdateContext.POSE_UPDATE)
        elif update.update_type != UpdateContext.FULL_UPDATE:
            update.update_type = UpdateContext.POSE_UPDATE
        update.int_marker.pose = pose
        update.int_marker.header = header

    def _is_first_client(self, known: MarkerContext, feedback: Any) -> bool:
        """Whether no other client moved the marker just now."""
        since = self.node.get_clock().now() - known.last_feedback
        if known.last_client_id == feedback.client_id or since >= Duration(seconds=_OWNED_S):
            return True
        logger = self.node.get_logger()
        logger.debug(
            f"Rejecting feedback for '{feedback.marker_name}': conflicting feedback from separate clients"
        )
        return False

    def _erase(self, name: str) -> bool:
        if (update := self.pending_updates.get(name)) is not None:
            update.update_type = UpdateContext.ERASE
        elif name in self.marker_contexts:
            self.pending_updates[name] = UpdateContext(UpdateContext.ERASE)
        else:
            return False
        return True

    def _apply(self, name: str, update: UpdateContext, message: Any) -> None:
        """Make a change, and add it to the message for clients."""
        known = self.marker_contexts.get(name)
        if update.update_type == UpdateContext.FULL_UPDATE:
            if known is None:
                known = self.marker_contexts[name] = MarkerContext(self.node.get_clock().now())
                known.default_feedback_callback = update.default_feedback_callback
                known.feedback_callbacks = update.feedback_callbacks
            known.int_marker = update.int_marker
            message.markers.append(known.int_marker)
        elif known is None:
            return  # it was inserted and erased again
        elif update.update_type == UpdateContext.ERASE:
            del self.marker_contexts[name]
            message.erases.append(name)
        else:
            marker = known.int_marker
            marker.pose, marker.header = update.int_marker.pose, update.int_marker.header
            message.poses.append(_Pose(header=marker.header, pose=marker.pose, name=marker.name))
