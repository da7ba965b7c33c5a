"""The common interface of all sources of transforms: transform an object of any registered type.

Owns: the registrations of types, for all of the process. Must not know: the source of transforms.
"""

from collections.abc import Callable
from copy import deepcopy
from typing import Any, ClassVar, TypeVar

from bus_ros.rclpy.duration import Duration
from bus_tf2.messages import message

__all__ = [
    "BufferInterface",
    "ConvertRegistration",
    "NotImplementedException",
    "Stamped",
    "TransformRegistration",
    "TypeException",
    "convert",
]

Convert = Callable[[Any], Any]
Function = TypeVar("Function", bound=Callable[..., Any])


class TypeException(Exception):
    """The type is not registered."""

    def __init__(self, errstr: str) -> None:
        super().__init__(errstr)
        self.errstr = errstr


class NotImplementedException(Exception):
    """A class derived from BufferInterface lacks a method."""

    def __init__(self) -> None:
        self.errstr = "CanTransform or LookupTransform not implemented"
        super().__init__(self.errstr)


class TransformRegistration:
    """How objects of a type are transformed: functions of an object and a TransformStamped."""

    _functions: ClassVar[dict[Any, Callable[[Any, Any], Any]]] = {}

    def print_me(self) -> None:
        print(self._functions)

    def add(self, key: Any, callback: Callable[[Any, Any], Any]) -> None:
        self._functions[key] = callback

    def get(self, key: Any) -> Callable[[Any, Any], Any]:
        """Raises TypeException."""
        return _registered(self._functions, key)


class ConvertRegistration:
    """How an object becomes another type: by a function for the two, or through a message."""

    _to_msg: ClassVar[dict[Any, Convert]] = {}
    _from_msg: ClassVar[dict[Any, Convert]] = {}
    _direct: ClassVar[dict[Any, Convert]] = {}

    def add_from_msg(self, key: Any, callback: Convert) -> None:
        self._from_msg[key] = callback

    def add_to_msg(self, key: Any, callback: Convert) -> None:
        self._to_msg[key] = callback

    def add_convert(self, key: tuple[Any, Any], callback: Convert) -> None:
        self._direct[key] = callback

    def get_from_msg(self, key: Any) -> Convert:
        """Raises TypeException, as the two below."""
        return _registered(self._from_msg, key)

    def get_to_msg(self, key: Any) -> Convert:
        return _registered(self._to_msg, key)

    def get_convert(self, key: tuple[Any, Any]) -> Convert:
        return _registered(self._direct, key)


def _registered(functions: dict[Any, Function], key: Any) -> Function:
    if key not in functions:
        raise TypeException(f"Type {key} is not loaded or supported")
    return functions[key]


def Stamped(obj: Any, stamp: Any, frame_id: str) -> Any:
    """Give an object a header, and return it."""
    obj.header = message("std_msgs/msg/Header", frame_id=frame_id, stamp=stamp)
    return obj


def convert(a: Any, b_type: Any) -> Any:
    """`a` as a `b_type`, a copy. Raises TypeException."""
    known = ConvertRegistration()
    try:
        return known.get_convert((type(a), b_type))(a)
    except TypeException:
        if type(a) is b_type:
            return deepcopy(a)
        return known.get_from_msg(b_type)(known.get_to_msg(type(a))(a))


class BufferInterface:
    """The base of classes that look transforms up. A derived class has the four methods that raise here."""

    def __init__(self) -> None:
        self.registration = TransformRegistration()

    def transform(
        self,
        object_stamped: Any,
        target_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
        new_type: Any = None,
    ) -> Any:
        """An object with a header, in the coordinates of `target_frame`, at its own time.

        Its type is registered, for messages by importing tf2_geometry_msgs or tf2_sensor_msgs. `new_type`:
        the type of the result. Raises TypeException, and the errors of a look-up.
        """
        function = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform(target_frame, header.frame_id, header.stamp, timeout)
        return _as_type(function(object_stamped, found), new_type)

    def transform_full(
        self,
        object_stamped: Any,
        target_frame: str,
        target_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
        new_type: Any = None,
    ) -> Any:
        """The same at another time, by a frame that does not move in between."""
        function = self.registration.get(type(object_stamped))
        header = object_stamped.header
        found = self.lookup_transform_full(
            target_frame, target_time, header.frame_id, header.stamp, fixed_frame, timeout
        )
        return _as_type(function(object_stamped, found), new_type)

    def lookup_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        raise NotImplementedException

    def lookup_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        raise NotImplementedException

    def can_transform(
        self,
        target_frame: str,
        source_frame: str,
        time: Any,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        raise NotImplementedException

    def can_transform_full(
        self,
        target_frame: str,
        target_time: Any,
        source_frame: str,
        source_time: Any,
        fixed_frame: str,
        timeout: Duration = Duration(),  # noqa: B008
    ) -> Any:
        raise NotImplementedException


def _as_type(made: Any, new_type: Any) -> Any:
    return made if new_type is None else convert(made, new_type)
