"""BufferCore: tf2's answers, exceptions and texts, on the native core and on its twin."""

import math
from typing import Any

import pytest

from bus_ros.rclpy.duration import Duration
from bus_ros.rclpy.time import Time
from bus_tf2.messages import message
from bus_tf2.tf2_py import (
    BufferCore,
    ConnectivityException,
    ExtrapolationException,
    InvalidArgumentException,
    LookupException,
    TransformException,
)
from tf2_world import at, buffer, either_core, transform, yaw

__all__ = ["buffer", "either_core"]

NOW = Time()


def moved(found: Any) -> tuple[float, float, float]:
    place = found.transform.translation
    return place.x, place.y, place.z


def turned(found: Any) -> tuple[float, float, float, float]:
    place = found.transform.rotation
    return place.x, place.y, place.z, place.w


def refusal(buffer: BufferCore, target: str, source: str, time: Time, kind: type[Exception]) -> str:
    """The text of the error. `can_transform_core` has the same text if the names are known."""
    with pytest.raises(kind) as caught:
        buffer.lookup_transform_core(target, source, time)
    text = str(caught.value)
    can, why = buffer.can_transform_core(target, source, time)
    assert can == 0
    assert why == text or kind in (LookupException, InvalidArgumentException)
    return text


class TestLookup:
    def test_both_ways_and_across(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("world", "left", 0, (1, 0, 0), yaw(math.pi / 2)), "me")
        buffer.set_transform_static(transform("world", "right", 0, (0, 2, 0)), "me")
        up = buffer.lookup_transform_core("world", "left", NOW)
        assert (up.header.frame_id, up.child_frame_id) == ("world", "left")
        assert moved(up) == (1.0, 0.0, 0.0)
        assert turned(up) == pytest.approx(yaw(math.pi / 2))
        down = buffer.lookup_transform_core("left", "world", NOW)
        assert moved(down) == pytest.approx((0.0, 1.0, 0.0))
        assert turned(down) == pytest.approx(yaw(-math.pi / 2))
        across = buffer.lookup_transform_core("left", "right", NOW)
        assert moved(across) == pytest.approx((2.0, 1.0, 0.0))
        assert buffer._chain("left", NOW, "right", NOW, "world") == ["right", "world", "left"]

    def test_in_between(self, buffer: BufferCore) -> None:
        buffer.set_transform(transform("world", "robot", 1, (0, 0, 0), yaw(0.0)), "me")
        buffer.set_transform(transform("world", "robot", 2, (2, 4, 6), yaw(1.0)), "me")
        found = buffer.lookup_transform_core("world", "robot", at(1.25))
        assert moved(found) == pytest.approx((0.5, 1.0, 1.5))
        assert turned(found) == pytest.approx(yaw(0.25))
        assert (found.header.stamp.sec, found.header.stamp.nanosec) == (1, 250_000_000)

    def test_time_zero_is_the_latest_that_all_have(self, buffer: BufferCore) -> None:
        for second in (1, 2, 3):
            buffer.set_transform(transform("world", "robot", second, (second, 0, 0)), "me")
        buffer.set_transform(transform("robot", "arm", 1.5), "me")
        buffer.set_transform(transform("robot", "arm", 2.5), "me")
        buffer.set_transform_static(transform("arm", "hand"), "me")
        found = buffer.lookup_transform_core("world", "hand", NOW)
        assert moved(found) == (2.5, 0.0, 0.0)
        assert found.header.stamp.nanosec == 500_000_000
        assert buffer.get_latest_common_time("world", "hand") == at(2.5)
        assert buffer.get_latest_common_time("arm", "hand") == at(0)
        assert buffer.get_latest_common_time("robot", "robot") == at(3)

    def test_itself(self, buffer: BufferCore) -> None:
        assert moved(buffer.lookup_transform_core("nobody", "nobody", at(5))) == (0.0, 0.0, 0.0)
        assert buffer.can_transform_core("nobody", "nobody", NOW) == (1, "")
        buffer.set_transform(transform("world", "robot", 7), "me")
        assert buffer.lookup_transform_core("robot", "robot", NOW).header.stamp.sec == 7

    def test_full(self, buffer: BufferCore) -> None:
        for second in (1, 2):
            buffer.set_transform(transform("map", "robot", second, (second, 0, 0)), "me")
        found = buffer.lookup_transform_full_core("robot", at(2), "robot", at(1), "map")
        assert moved(found) == (-1.0, 0.0, 0.0)
        assert found.header.stamp.sec == 2
        assert buffer.can_transform_full_core("robot", at(2), "robot", at(1), "map") == (1, "")
        assert buffer.can_transform_full_core("robot", at(2), "robot", at(1), "nowhere") == (
            0,
            'Invalid frame ID "nowhere" passed to canTransform argument fixed_frame - frame does not exist',
        )
        with pytest.raises(ExtrapolationException):
            buffer.lookup_transform_full_core("robot", at(3), "robot", at(1), "map")

    def test_a_message_as_time(self, buffer: BufferCore) -> None:
        buffer.set_transform(transform("a", "b", 3.5), "me")
        stamp = message("builtin_interfaces/msg/Time", sec=3, nanosec=500_000_000)
        assert buffer.lookup_transform_core("a", "b", stamp).header.stamp == stamp
        with pytest.raises(TypeError, match=r"^time must have sec and nanosec, or nanoseconds\.$"):
            buffer.lookup_transform_core("a", "b", 3.5)  # type: ignore[arg-type]

    def test_slashes_are_stripped_from_what_is_told(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("/world", "/robot"), "me")
        assert buffer._getFrameStrings() == ["robot", "world"]


class TestRefusals:
    def test_names(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("world", "robot"), "me")
        assert refusal(buffer, "world", "nobody", NOW, LookupException) == (
            '"nobody" passed to lookupTransform argument source_frame does not exist. '
        )
        assert refusal(buffer, "", "robot", NOW, InvalidArgumentException) == (
            'Invalid argument "" passed to lookupTransform argument target_frame - '
            "in tf2 frame_ids cannot be empty"
        )
        assert refusal(buffer, "world", "/robot", NOW, InvalidArgumentException) == (
            'Invalid argument "/robot" passed to lookupTransform argument source_frame - '
            "in tf2 frame_ids cannot start with a '/'"
        )
        assert buffer.can_transform_core("/world", "robot", NOW) == (
            0,
            'Invalid frame ID "/world" passed to canTransform argument target_frame - '
            "in tf2 frame_ids cannot start with a '/'",
        )

    def test_extrapolation(self, buffer: BufferCore) -> None:
        buffer.set_transform(transform("a", "b", 1), "me")
        suffix = ", when looking up transform from frame [b] to frame [a]"
        assert refusal(buffer, "a", "b", at(2), ExtrapolationException) == (
            "Lookup would require extrapolation at time 2.000000, but only time 1.000000 is in the buffer"
            + suffix
        )
        buffer.set_transform(transform("a", "b", 2), "me")
        assert refusal(buffer, "a", "b", at(2.5), ExtrapolationException) == (
            "Lookup would require extrapolation into the future.  Requested time 2.500000 but the latest "
            "data is "
            "at time 2.000000" + suffix
        )
        assert refusal(buffer, "a", "b", at(0.5), ExtrapolationException) == (
            "Lookup would require extrapolation into the past.  Requested time 0.500000 but the earliest "
            "data is "
            "at time 1.000000" + suffix
        )

    def test_times_that_no_stamp_can_have(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("a", "b"), "me")
        late = message("builtin_interfaces/msg/Time", sec=2**31 - 1, nanosec=10**9)
        fault = "Invalid time 2147483648.000000: a stamp has its seconds in 32 bits"
        assert buffer.can_transform_core("a", "b", late) == (0, fault)
        for look_up in (
            lambda: buffer.lookup_transform_core("a", "b", late),
            lambda: buffer.lookup_transform_core("a", "a", Time(nanoseconds=2**63 - 1)),
            lambda: buffer.lookup_transform_full_core("a", late, "b", NOW, "a"),
        ):
            with pytest.raises(InvalidArgumentException, match=r"^Invalid time"):
                look_up()

    def test_names_with_escape_sequences(
        self, buffer: BufferCore, capsys: pytest.CaptureFixture[str]
    ) -> None:
        hostile, shown = "\x1b[2Jb", r"\x1b[2Jb"
        buffer.set_transform(transform("a", hostile, 1), "me")
        text = refusal(buffer, "a", hostile, at(2), ExtrapolationException)
        assert text.endswith(f"from frame [{shown}] to frame [a]")
        buffer.set_transform(transform(hostile, hostile), "me")
        assert f'"{shown}"' in capsys.readouterr().err

    def test_two_trees(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("a", "b"), "me")
        buffer.set_transform_static(transform("c", "d"), "me")
        text = (
            "Could not find a connection between 'a' and 'd' because they are not part of the same tree."
            "Tf has two or more unconnected trees."
        )
        assert refusal(buffer, "a", "d", NOW, ConnectivityException) == text
        with pytest.raises(TransformException, match=text):
            buffer.get_latest_common_time("a", "d")

    def test_a_loop(self, buffer: BufferCore) -> None:
        for parent, child in (("a", "b"), ("b", "a"), ("c", "d")):
            buffer.set_transform(transform(parent, child, 1), "me")
        text = refusal(buffer, "c", "a", at(1), LookupException)
        assert text.startswith(
            "The tf tree is invalid because it contains a loop.\nFrame b exists with parent a.\n"
        )

    def test_after_clear(self, buffer: BufferCore) -> None:
        buffer.set_transform(transform("a", "b", 1), "me")
        buffer.set_transform_static(transform("b", "c"), "me")
        buffer.clear()
        assert refusal(buffer, "a", "b", at(1), ExtrapolationException) == (
            ", when looking up transform from frame [b] to frame [a]"
        )
        assert buffer.can_transform_core("b", "c", at(1)) == (1, "")
        assert (
            buffer.all_frames_as_string()
            == "Frame b exists with parent NO_PARENT.\nFrame c exists with parent b.\n"
        )


class TestWhatIsTold:
    def test_what_is_ignored(self, buffer: BufferCore, capsys: pytest.CaptureFixture[str]) -> None:
        for wrong in (
            transform("a", "b", 1, (math.nan, 0, 0)),
            transform("a", "b", 1, turned=(0, 0, 0, 0)),
            transform("a", "/a", 1),
            transform("a", "", 1),
            transform("", "b", 1),
        ):
            buffer.set_transform(wrong, "me")
        assert buffer._getFrameStrings() == []
        assert capsys.readouterr().err == (
            'Error:   TF_NAN_INPUT: Ignoring transform for child_frame_id "b" from authority "me" because '
            "of a nan "
            "value in the transform (nan 0.000000 0.000000) (0.000000 0.000000 0.000000 1.000000)\n"
            'Error:   TF_DENORMALIZED_QUATERNION: Ignoring transform for child_frame_id "b" from '
            'authority "me" '
            "because of an invalid quaternion in the transform (0.000000 0.000000 0.000000 0.000000)\n"
            'Error:   TF_SELF_TRANSFORM: Ignoring transform from authority "me" with frame_id and  '
            "child_frame_id "
            '"a" because they are the same\n'
            'Error:   TF_NO_CHILD_FRAME_ID: Ignoring transform from authority "me" because child_frame_id '
            "not set \n"
            'Error:   TF_NO_FRAME_ID: Ignoring transform with child_frame_id "b"  from authority "me" '
            "because "
            "frame_id not set\n"
        )

    def test_unusual_stamps(self, buffer: BufferCore, capsys: pytest.CaptureFixture[str]) -> None:
        """A second's worth of nanoseconds, or a time before 1970, is a time like others."""
        stamped = transform("a", "b")
        stamp = stamped.header.stamp
        for stamp.sec, stamp.nanosec, found in (
            (1, 2_500_000_000, (3, 500_000_000)),
            (-2, 2_500_000_000, (0, 500_000_000)),
            (-(2**31), 5, (-(2**31), 5)),
        ):
            buffer.clear()
            buffer.set_transform(stamped, "me")
            for time in (stamp, NOW):
                answer = buffer.lookup_transform_core("a", "b", time).header.stamp
                assert (answer.sec, answer.nanosec) == found
        assert capsys.readouterr().err == ""
        buffer.clear()
        stamp.sec, stamp.nanosec = 2**31 - 1, 10**9
        buffer.set_transform(stamped, "me")
        assert buffer.can_transform_core("a", "b", NOW)[0] == 0
        assert capsys.readouterr().err == (
            'Error:   Ignoring transform for child_frame_id "b" from authority "me": Invalid time '
            "2147483648.000000: a stamp has its seconds in 32 bits\n"
        )

    def test_a_long_quaternion_is_made_short(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("a", "b", turned=(0, 0, 0, 2)), "me")
        assert turned(buffer.lookup_transform_core("a", "b", NOW)) == (0.0, 0.0, 0.0, 1.0)

    def test_what_is_too_old(self, buffer: BufferCore, capsys: pytest.CaptureFixture[str]) -> None:
        buffer.set_transform(transform("a", "b", 100), "me")
        buffer.set_transform(transform("a", "b", 90), "other")
        buffer.set_transform(transform("a", "b", 89.5), "other")
        assert capsys.readouterr().err == (
            "Warning: TF_OLD_DATA ignoring data from the past for frame b at time 89.500000 according to "
            "authority "
            "other\nPossible reasons are listed at http://wiki.ros.org/tf/Errors%20explained\n"
        )

    def test_ten_seconds_are_kept(self, buffer: BufferCore) -> None:
        for second in range(1, 31):
            buffer.set_transform(transform("a", "b", second, (second, 0, 0)), "me")
        assert moved(buffer.lookup_transform_core("a", "b", at(20.5))) == (20.5, 0.0, 0.0)
        assert "the earliest data is at time 19.000000" in refusal(
            buffer, "a", "b", at(18), ExtrapolationException
        )

    def test_another_cache_time(self, either_core: None) -> None:
        buffer = BufferCore(Duration(seconds=1))
        for second in (1, 2, 3, 4):
            buffer.set_transform(transform("a", "b", second), "me")
        assert "the earliest data is at time 2.000000" in refusal(
            buffer, "a", "b", at(1.5), ExtrapolationException
        )

    def test_two_authorities(self, buffer: BufferCore) -> None:
        """For one time, the last transform that arrived counts."""
        buffer.set_transform(transform("a", "b", 1, (1, 0, 0)), "one")
        buffer.set_transform(transform("a", "b", 1, (2, 0, 0)), "other")
        assert moved(buffer.lookup_transform_core("a", "b", NOW)) == (2.0, 0.0, 0.0)
        assert "broadcaster: 'other'" in buffer.all_frames_as_yaml()

    def test_a_refused_transform_changes_no_authority(self, buffer: BufferCore) -> None:
        buffer.set_transform(transform("a", "b", 100), "me")
        buffer.set_transform(transform("a", "b", 1), "other")
        assert "broadcaster: 'me'" in buffer.all_frames_as_yaml()

    def test_the_last_static_transform_counts_whatever_its_time(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("a", "b", 10, (1, 0, 0)), "me")
        buffer.set_transform_static(transform("a", "b", 5, (2, 0, 0)), "me")
        assert moved(buffer.lookup_transform_core("a", "b", NOW)) == (2.0, 0.0, 0.0)

    def test_another_parent(self, buffer: BufferCore) -> None:
        buffer.set_transform(transform("a", "x", 1, (1, 0, 0)), "me")
        buffer.set_transform(transform("b", "x", 2, (2, 0, 0)), "me")
        buffer.set_transform_static(transform("a", "b"), "me")
        assert moved(buffer.lookup_transform_core("a", "x", at(1))) == (1.0, 0.0, 0.0)
        assert moved(buffer.lookup_transform_core("a", "x", at(1.5))) == (1.0, 0.0, 0.0)
        assert moved(buffer.lookup_transform_core("b", "x", at(2))) == (2.0, 0.0, 0.0)

    def test_static_and_then_not(self, buffer: BufferCore) -> None:
        buffer.set_transform_static(transform("a", "b", 0, (1, 0, 0)), "me")
        buffer.set_transform(transform("a", "b", 5, (2, 0, 0)), "me")
        refusal(buffer, "a", "b", at(1), ExtrapolationException)
        buffer.set_transform_static(transform("a", "b", 0, (3, 0, 0)), "me")
        assert moved(buffer.lookup_transform_core("a", "b", at(1))) == (3.0, 0.0, 0.0)


class TestLists:
    def test_of_nothing(self, buffer: BufferCore) -> None:
        assert buffer.all_frames_as_yaml() == "[]"
        assert buffer.all_frames_as_string() == ""
        assert buffer._allFramesAsDot() == 'digraph G {\n"no tf data recieved"}'
        assert not buffer._frameExists("a")

    def test_as_yaml_and_dot(self, buffer: BufferCore) -> None:
        for second in (1.0, 1.5, 2.0):
            buffer.set_transform(transform("world", "robot", second), "me")
        assert buffer.all_frames_as_yaml() == (
            "robot: \n"
            "  parent: 'world'\n"
            "  broadcaster: 'me'\n"
            "  rate: 3.000\n"
            "  most_recent_transform: 2.000000\n"
            "  oldest_transform: 1.000000\n"
            "  buffer_length: 1.000\n"
        )
        assert buffer._allFramesAsDot(at(3)) == (
            "digraph G {\n"
            '"world" -> "robot"[label="Broadcaster: me\\nAverage rate: 3.000 Hz\\n'
            'Most recent transform: 2.000000 ( 1.000 sec old)\\nBuffer length: 1.000 sec\\n"];\n'
            "edge [style=invis];\n"
            ' subgraph cluster_legend { style=bold; color=black; label ="view_frames Result";\n'
            '"Recorded at time: 3.000000"[ shape=plaintext ] ;\n'
            ' }->"world";\n'
            "}"
        )

    def test_chains(self, buffer: BufferCore) -> None:
        for parent, child in (("a", "b"), ("b", "c"), ("a", "d"), ("d", "e")):
            buffer.set_transform_static(transform(parent, child), "me")
        for target, source, fixed, way in (
            ("c", "c", "c", "c"),
            ("a", "c", "c", "cba"),
            ("c", "a", "c", "abc"),
            ("e", "c", "a", "cbade"),
            ("e", "c", "b", "cbade"),
            ("e", "c", "e", "cbade"),
            ("e", "c", "d", "cbade"),
        ):
            assert buffer._chain(target, NOW, source, NOW, fixed) == list(way), (target, source, fixed)
        with pytest.raises(LookupException):
            buffer._chain("x", NOW, "a", NOW, "a")
