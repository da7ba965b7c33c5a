"""BufferCore: from messages into the numeric core and back, with tf2's exceptions and texts.

Owns: reading and making TransformStamped, the exception for each error, warnings on stderr. Must not know:
topics, nodes, waiting.
"""

import sys
from typing import TYPE_CHECKING, Any, NoReturn, Protocol, cast

from bus.base.printable import printable
from bus_tf2.core import FrameTree, texts
from bus_tf2.core.rotation import composed
from bus_tf2.core.twin import IS_DENORMALIZED, IS_NAN, IS_OLD, LOOP, UNCONNECTED, UNKNOWN, Answer, Failure
from bus_tf2.messages import message_type
from bus_tf2.tf2_py.exceptions import (
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)

if TYPE_CHECKING:
    from bus_ros.rclpy.time import Time

__all__ = ["BufferCore"]

_CACHE_NS = 10_000_000_000
_MOST_NS = (1 << 63) - 1
_FIRST_NS, _END_NS = -(2**31) * 1_000_000_000, 2**31 * 1_000_000_000


class _Nanoseconds(Protocol):
    @property
    def nanoseconds(self) -> int: ...


class _Message(Protocol):
    sec: int
    nanosec: int


Moment = _Nanoseconds | _Message
"""rclpy's Time or Duration, or a message of those."""


class BufferCore:
    """Keeps transforms of the last seconds and answers for each pair of frames and each time among them.

    `cache_time`: how long transforms are kept, a Duration; None: 10 s. Time zero means the latest time that
    both frames have. Methods may be called in any thread.
    """

    def __init__(self, cache_time: Moment | None = None) -> None:
        cache_ns = _CACHE_NS if cache_time is None else _in_ns(cache_time, "duration")
        self.__tree = FrameTree(min(max(cache_ns, 0), _MOST_NS))

    def set_transform(self, transform: Any, authority: str) -> None:
        """Take in a TransformStamped that `authority` tells. A transform that can't be right is ignored, with
        a line on stderr.
        """
        self.__insert(transform, authority, is_static=False)

    def set_transform_static(self, transform: Any, authority: str) -> None:
        """Like `set_transform`, for a transform that is valid at all times."""
        self.__insert(transform, authority, is_static=True)

    def can_transform_core(self, target_frame: str, source_frame: str, time: Moment) -> tuple[int, str]:
        """Whether `lookup_transform_core` has an answer, as 1 or 0, and why not."""
        try:
            found = self.__tree.lookup(target_frame, source_frame, _time_ns(time))
        except InvalidArgumentException as error:
            return 0, str(error)
        if len(found) == 8:
            return 1, ""
        return 0, self.__why_not(found, target_frame, source_frame)

    def can_transform_full_core(
        self, target_frame: str, target_time: Moment, source_frame: str, source_time: Moment, fixed_frame: str
    ) -> tuple[int, str]:
        """Whether `lookup_transform_full_core` has an answer, as 1 or 0, and why not."""
        for frame, role in ((target_frame, "target"), (source_frame, "source"), (fixed_frame, "fixed")):
            if fault := self.__fault(frame):
                return 0, _invalid(frame, f"canTransform argument {role}_frame", fault)
        for to, of, time in (
            (target_frame, fixed_frame, target_time),
            (fixed_frame, source_frame, source_time),
        ):
            can, why = self.can_transform_core(to, of, time)
            if not can:
                return can, why
        return 1, ""

    def lookup_transform_core(self, target_frame: str, source_frame: str, time: Moment) -> Any:
        """The TransformStamped that takes coordinates in `source_frame` into `target_frame`.

        Raises LookupException, ConnectivityException, ExtrapolationException, InvalidArgumentException.
        """
        found = self.__tree.lookup(target_frame, source_frame, _time_ns(time))
        if len(found) != 8:
            self.__refuse(found, target_frame, source_frame)
        return _stamped(target_frame, source_frame, found)

    def lookup_transform_full_core(
        self, target_frame: str, target_time: Moment, source_frame: str, source_time: Moment, fixed_frame: str
    ) -> Any:
        """The transform from `source_frame` at one time into `target_frame` at another time.

        Uses a frame that does not move in between. Errors as above.
        """
        self.__validate(target_frame, "lookupTransform argument target_frame")
        self.__validate(source_frame, "lookupTransform argument source_frame")
        self.__validate(fixed_frame, "lookupTransform argument fixed_frame")
        inner = self.__find(fixed_frame, source_frame, _time_ns(source_time))
        outer = self.__find(target_frame, fixed_frame, _time_ns(target_time))
        (x, y, z), (qx, qy, qz, qw) = composed((outer[1:4], outer[4:]), (inner[1:4], inner[4:]))
        return _stamped(target_frame, source_frame, (outer[0], x, y, z, qx, qy, qz, qw))

    def get_latest_common_time(self, target_frame: str, source_frame: str) -> "Time":
        """The latest time for which both frames have transforms; zero if all between them is static.

        Raises as above; TransformException if the two are not connected; ValueError, as in ROS 2, if the time
        is below zero.
        """
        from bus_ros.rclpy.time import Time

        self.__validate(target_frame, "get_latest_common_time")
        self.__validate(source_frame, "get_latest_common_time")
        found = self.__tree.latest(target_frame, source_frame)
        if not isinstance(found, int):
            raise TransformException(self.__text(found, target_frame, source_frame))
        return Time(nanoseconds=found)

    def clear(self) -> None:
        """Forget all transforms but static ones."""
        self.__tree.clear()

    def all_frames_as_yaml(self) -> str:
        return texts.all_frames_as_yaml(self.__tree.rows(), is_empty=not self.__tree.names())

    def all_frames_as_string(self) -> str:
        return texts.all_frames(self.__tree.rows())

    def _allFramesAsDot(self, time: Moment | None = None) -> str:
        now_ns = 0 if time is None else _in_ns(time, "time")
        return texts.all_frames_as_dot(self.__tree.rows(), self.__tree.names(), now_ns)

    def _frameExists(self, frame_id: str) -> bool:
        return self.__tree.knows(frame_id)

    def _getFrameStrings(self) -> list[str]:
        return self.__tree.names()

    def _chain(
        self, target_frame: str, target_time: Moment, source_frame: str, source_time: Moment, fixed_frame: str
    ) -> list[str]:
        """The frames on the way from the source to the fixed frame, and on to the target."""
        down = self.__way(target_frame, fixed_frame, _time_ns(target_time))
        way = self.__way(source_frame, fixed_frame, _time_ns(source_time))
        while len(way) > 1 and len(down) > 1 and way[-2] == down[-2]:
            way.pop()
            down.pop()
        return [*way, *reversed(down[:-1])]

    def __way(self, start: str, end: str, time_ns: int) -> list[str]:
        """The frames from one to another, both included."""
        stamp_ns = self.__find(end, start, time_ns)[0]
        ups, downs = [start], [end]
        while (up := self.__tree.parent(ups[-1], stamp_ns)) is not None and ups[-1] != end:
            ups.append(up)
        while downs[-1] not in ups and (up := self.__tree.parent(downs[-1], stamp_ns)) is not None:
            downs.append(up)
        return [*ups[: ups.index(downs[-1])], *reversed(downs)]

    def __find(self, target: str, source: str, time_ns: int) -> Answer:
        found = self.__tree.lookup(target, source, time_ns)
        if len(found) != 8:
            self.__refuse(found, target, source)
        return found

    def __insert(self, message: Any, authority: str, *, is_static: bool) -> None:
        header, place = message.header, message.transform
        moved, turned = place.translation, place.rotation
        parent, child = header.frame_id.removeprefix("/"), message.child_frame_id.removeprefix("/")
        if not parent or not child or parent == child:
            _warn_of_names(parent, child, authority)
            return
        parts = (moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w)
        try:
            stamp_ns = _time_ns(header.stamp)
        except InvalidArgumentException as error:
            _say(
                f'Error:   Ignoring transform for child_frame_id "{child}" from authority "{authority}": '
                f"{error}"
            )
            return
        refused = self.__tree.insert(child, parent, stamp_ns, *parts, authority, is_static)
        if refused:
            _warn_of_numbers(refused, child, authority, parts, stamp_ns)

    def __fault(self, frame: str) -> str:
        return texts.frame_name_fault(frame) or ("" if self.__tree.knows(frame) else "frame does not exist")

    def __why_not(self, failure: Failure, target: str, source: str) -> str:
        for frame, role in ((target, "target"), (source, "source")):
            if fault := self.__fault(frame):
                return _invalid(frame, f"canTransform argument {role}_frame", fault)
        return printable(self.__text(failure, target, source))

    def __validate(self, frame: str, role: str) -> None:
        if fault := texts.frame_name_fault(frame):
            raise InvalidArgumentException(f'Invalid argument "{frame}" passed to {role} - {fault}')
        if not self.__tree.knows(frame):
            raise LookupException(f'"{frame}" passed to {role} does not exist. ')

    def __refuse(self, failure: Failure, target: str, source: str) -> NoReturn:
        if failure[0] == UNKNOWN:
            self.__validate(target, "lookupTransform argument target_frame")
            self.__validate(source, "lookupTransform argument source_frame")
        errors = {LOOP: LookupException, UNCONNECTED: ConnectivityException}
        raise errors.get(failure[0], ExtrapolationException)(self.__text(failure, target, source))

    def __text(self, failure: Failure, target: str, source: str) -> str:
        return texts.failure_text(failure, target, source, self.__tree.rows())


def _in_ns(time: Any, what: str) -> int:
    try:
        return cast(int, time.nanoseconds)
    except AttributeError:
        pass
    try:
        return int(time.sec) * 1_000_000_000 + int(time.nanosec)
    except AttributeError:
        raise TypeError(f"{what} must have sec and nanosec, or nanoseconds.") from None


def _time_ns(time: Moment) -> int:
    """Raises InvalidArgumentException for a time that no stamp can have: the answer could not name it."""
    time_ns = _in_ns(time, "time")
    if not _FIRST_NS <= time_ns < _END_NS:
        raise InvalidArgumentException(
            f"Invalid time {texts.seconds(time_ns)}: a stamp has its seconds in 32 bits"
        )
    return time_ns


def _stamped(target: str, source: str, found: Answer) -> Any:
    message = message_type("geometry_msgs/msg/TransformStamped")()
    header, place = message.header, message.transform
    moved, turned, stamp = place.translation, place.rotation, header.stamp
    stamp_ns, moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w = found
    stamp.sec, stamp.nanosec = divmod(stamp_ns, 1_000_000_000)
    header.frame_id, message.child_frame_id = target, source
    return message


def _invalid(frame: str, role: str, fault: str) -> str:
    return printable(f'Invalid frame ID "{frame}" passed to {role} - {fault}')


def _warn_of_names(parent: str, child: str, authority: str) -> None:
    if parent == child:
        _say(
            f'Error:   TF_SELF_TRANSFORM: Ignoring transform from authority "{authority}" with frame_id and  '
            f'child_frame_id "{child}" because they are the same'
        )
    if not child:
        _say(
            f'Error:   TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "{authority}" because '
            "child_frame_id not set "
        )
    if not parent:
        _say(
            f'Error:   TF_NO_FRAME_ID: Ignoring transform with child_frame_id "{child}"  from authority '
            f'"{authority}" because frame_id not set'
        )


def _warn_of_numbers(
    refused: int, child: str, authority: str, parts: tuple[float, ...], stamp_ns: int
) -> None:
    moved, turned = (" ".join(f"{part:f}" for part in some) for some in (parts[:3], parts[3:]))
    who = f'Ignoring transform for child_frame_id "{child}" from authority "{authority}" because of'
    if refused & IS_NAN:
        _say(f"Error:   TF_NAN_INPUT: {who} a nan value in the transform ({moved}) ({turned})")
    if refused & IS_DENORMALIZED:
        _say(f"Error:   TF_DENORMALIZED_QUATERNION: {who} an invalid quaternion in the transform ({turned})")
    if refused & IS_OLD:
        _say(
            f"Warning: TF_OLD_DATA ignoring data from the past for frame {child} at time "
            f"{texts.seconds(stamp_ns)} according to authority {authority}\n"
            "Possible reasons are listed at http://wiki.ros.org/tf/Errors%20explained"
        )


def _say(text: str) -> None:
    print(printable(text), file=sys.stderr)
