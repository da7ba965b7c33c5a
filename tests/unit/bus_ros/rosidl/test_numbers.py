"""The stored form of values assigned to an array or a number; numpy, if it is installed."""

import subprocess
import sys
from array import array
from typing import Any

import pytest

from bus_ros.rosidl import message_class


def cls(name: str) -> Any:
    return message_class(name)


def test_what_is_stored_for_what_is_assigned() -> None:
    scan = cls("sensor_msgs/msg/LaserScan")()
    scan.ranges = (1.0, float("inf"), 2.5)
    assert scan.ranges == array("f", [1.0, float("inf"), 2.5])
    kept = array("f", [1.0])
    scan.ranges = kept
    assert scan.ranges is kept
    image = cls("sensor_msgs/msg/Image")()
    for value in (b"\x01\xff", bytearray(b"\x01\xff"), memoryview(b"\x01\xff"), [1, 255]):
        image.data = value
        assert image.data == array("B", [1, 255])
    octets = cls("std_msgs/msg/ByteMultiArray")(data=b"ab")
    assert octets.data == [b"a", b"b"]
    number = cls("std_msgs/msg/Int32")(data=True)
    assert number.data == 1 and type(number.data) is int


def test_numpy_where_it_is_installed() -> None:
    np = pytest.importorskip("numpy")
    info = cls("sensor_msgs/msg/CameraInfo")()
    assert info.k.dtype == np.float64 and info.k.shape == (9,)
    info.k = np.arange(9.0).reshape(3, 3)
    assert info.k.tolist() == [float(i) for i in range(9)]
    info.k = np.ones(9, np.float32)
    assert info.k.dtype == np.float64 and info.k.tolist() == [1.0] * 9
    with pytest.raises(AssertionError, match="The 'k' field must be a set or sequence with length 9"):
        info.k = np.zeros(8, np.float32)
    with pytest.raises(AssertionError, match=r"The 'k' numpy.ndarray\(\) must have a size of 9"):
        info.k = np.zeros(8)
    scan = cls("sensor_msgs/msg/LaserScan")(ranges=np.arange(3.0), range_min=np.float32(0.5))
    assert scan.ranges == array("f", [0.0, 1.0, 2.0])
    scan.ranges = np.ones((2, 2), np.int32)
    assert scan.ranges == array("f", [1.0] * 4)
    with pytest.raises(AssertionError, match="The 'data' field must be a set or sequence"):
        cls("std_msgs/msg/Int32MultiArray")(data=np.array([0.5]))
    assert type(scan.range_min) is float
    scan.range_max = np.float64(2.0)
    assert cls("std_msgs/msg/Int32")(data=np.int64(7)).data == 7
    assert cls("std_msgs/msg/Bool")(data=np.bool_(True)).data is True
    assert list(cls("sensor_msgs/msg/LaserScan")(ranges=[np.float32(0.5), 1.0]).ranges) == [0.5, 1.0]
    with pytest.raises(AssertionError, match="must be an integer in"):
        cls("std_msgs/msg/Int8")(data=np.int64(300))
    assert cls("sensor_msgs/msg/Image")(data=np.ones((2, 2), np.uint8)).data == array("B", [1] * 4)


@pytest.mark.parametrize("dtype", [">i4", "<i4", ">u2", ">i8"])
def test_numpy_of_another_byte_order(dtype: str) -> None:
    """A past fault: they were read in this machine's byte order, which changed the values."""
    np = pytest.importorskip("numpy")
    array_of = np.array([1, 2, 300], np.dtype(dtype))
    assert cls("std_msgs/msg/Int32MultiArray")(data=array_of).data == array("i", [1, 2, 300])
    assert cls("std_msgs/msg/Int64MultiArray")(data=array_of).data == array("q", [1, 2, 300])


def test_numpy_is_not_imported_before_an_array_needs_it() -> None:
    code = (
        "import sys\n"
        "from bus_ros.rosidl import message_class\n"
        "message_class('std_msgs/msg/Float64MultiArray')(data=[1.0])\n"
        "message_class('sensor_msgs/msg/CameraInfo')\n"
        "assert 'numpy' not in sys.modules\n"
        "sys.modules['numpy'] = None\n"  # as if it were not installed
        "info = message_class('sensor_msgs/msg/CameraInfo')(k=[1.0] * 9)\n"
        "print(type(info.k).__name__, len(info.p), info == info)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60)
    assert done.stdout == "array 12 True\n"
