"""Hashes of real ROS 2 systems, and hashes of types that ROS 2 does not have."""

from typing import Annotated, Any, Literal

from msgspec import Meta, Struct

from bus.msg import Message, byte_array, float64, uint8, uint8_array
from bus.msg.geometry_msgs import Point
from bus.types.hash import schema_hash
from bus.types.schema import describe
from bus.types.support import find_type, type_hash
from rows import for_each

# From public ROS 2 programs, logs and rmw_zenoh key expressions.
KNOWN = """
std_msgs/msg/Header f49fb3ae2cf070f793645ff749683ac6b06203e41c891e17701b1cb597ce6a01
std_msgs/msg/String df668c740482bbd48fb39d76a70dfd4bd59db1288021743503259e948f6b1a18
std_msgs/msg/UInt64MultiArray fc1c685c2f76bdc6983da025cb25d2db5fb5157b059e300f6d957d86f981b366
rcl_interfaces/msg/Log e28ce254ca8abc06abf92773b74602cdbf116ed34fbaf294fb9f81da9f318eac
geometry_msgs/msg/Point 6963084842a9b04494d6b2941d11444708d892da2f4b09843b9c43f42a7f6881
geometry_msgs/msg/Pose d501954e9476cea2996984e812054b68026ae0bfae789d9a10b23daf35cc90fa
geometry_msgs/msg/PoseStamped 10f3786d7d40fd2b54367835614bff85d4ad3b5dab62bf8bca0cc232d73b4cd8
geometry_msgs/msg/PoseWithCovariance 9a7c0fd234b7f45c6098745ecccd773ca1085670e64107135397aee31c02e1bb
geometry_msgs/msg/PoseWithCovarianceStamped 26432f9803e43727d3c8f668d1fdb3c630f548af631e2f4e31382371bfea3b6e
geometry_msgs/msg/Quaternion 8a765f66778c8ff7c8ab94afcc590a2ed5325a1d9a076ffff38fbce36f458684
geometry_msgs/msg/Transform beb83fbe698636351461f6f35d1abb20010c43d55374d81bd041f1ba2581fddc
geometry_msgs/msg/TransformStamped 0a241f87d04668d94099cbb5ba11691d5ad32c2f29682e4eb5653424bd275206
geometry_msgs/msg/Twist 9c45bf16fe0983d80e3cfe750d6835843d265a9a6c46bd2e609fcddde6fb8d2a
geometry_msgs/msg/Vector3 cc12fe83e4c02719f1ce8070bfd14aecd40f75a96696a67a2a1f37f7dbb0765d
nav_msgs/msg/Odometry 3cc97dc7fb7502f8714462c526d369e35b603cfc34d946e3f2eda2766dfec6e0
nav_msgs/msg/Path 1957a5bb3cee5da65c4e52e52b65a93df227efce4c20f8458b36e73066ca334b
sensor_msgs/msg/BatteryState 4bee5dfce981c98faa6828b868307a0a73f992ed0789f374ee96c8f840e69741
sensor_msgs/msg/CameraInfo b3dfd68ff46c9d56c80fd3bd4ed22c7a4ddce8c8348f2f59c299e73118e7e275
sensor_msgs/msg/CompressedImage 15640771531571185e2efc8a100baf923961a4d15d5569652e6cb6691e8e371a
sensor_msgs/msg/Image d31d41a9a4c4bc8eae9be757b0beed306564f7526c88ea6a4588fb9582527d47
sensor_msgs/msg/Imu 7d9a00ff131080897a5ec7e26e315954b8eae3353c3f995c55faf71574000b5b
sensor_msgs/msg/JointState a13ee3a330e346c9d87b5aa18d24e11690752bd33a0350f11c5882bc9179260e
sensor_msgs/msg/MagneticField e80f32f56a20486c9923008fc1a1db07bbb273cbbf6a5b3bfa00835ee00e4dff
sensor_msgs/msg/NavSatStatus d1ed3befa628e09571bd273b888ba1c1fd187c9a5e0006b385d7e5e9095a3204
sensor_msgs/msg/PointCloud2 9198cabf7da3796ae6fe19c4cb3bdd3525492988c70522628af5daa124bae2b5
sensor_msgs/msg/PointField 5c6a4750728c2bcfbbf7037225b20b02d4429634732146b742dee1726637ef01
sensor_msgs/msg/Range b42b62562e93cbfe9d42b82fe5994dfa3d63d7d5c90a317981703f7388adff3a
sensor_msgs/msg/RegionOfInterest ad16bcba5f9131dcdba6fbded19f726f5440e3c513b4fb586dd3027eeed8abb1
"""


@for_each(("name", "digest"), [line.split() for line in KNOWN.strip().splitlines()])
def test_hash_of_real_ros_systems(name: str, digest: str) -> None:
    cls = find_type(name)
    assert cls is not None
    assert type_hash(cls) == f"RIHS01_{digest}"


def test_every_kind_of_ros_array_counts() -> None:
    def hash_of(annotation: Any) -> str:
        class Probe(Message, kw_only=True):
            __annotations__ = {"data": annotation}

        return type_hash(Probe)

    annotations = [
        uint8,
        uint8_array,
        byte_array,
        Annotated[bytes, Meta(min_length=16, max_length=16)],
        Annotated[bytes, Meta(max_length=16)],
        float64,
        list[float64],
        Annotated[list[float64], Meta(max_length=4)],
        Annotated[list[float64], Meta(min_length=4, max_length=4)],
        Annotated[list[float64], Meta(min_length=5, max_length=5)],
        Point,
        list[Point],
        Annotated[list[Point], Meta(min_length=4, max_length=4)],
        bool,
        str,
        list[str],
    ]
    hashes = [hash_of(annotation) for annotation in annotations]
    assert len(set(hashes)) == len(hashes)
    assert all(found.startswith("RIHS01_") for found in hashes)


def test_a_type_that_ros_does_not_have_gets_a_hash_of_ours() -> None:
    class AsMap(Struct):
        data: float = 0.0

    class Tagged(Message, tag=True):
        data: float = 0.0

    class NotForRos(Message):
        Data: float = 0.0

    class Python(Message):
        data: int | None = 0

    class Whole(Message):
        data: int = 0

    class AtLeast(Message):
        data: Annotated[list[float], Meta(min_length=1)]

    class Nested(Message):
        data: list[list[float]]

    class Word(Message):
        data: Literal["a", "b"] = "a"

    hashes = [type_hash(cls) for cls in (AsMap, Tagged, NotForRos, Python, Whole, AtLeast, Nested, Word)]
    assert all(found.startswith("BUS01_") and len(found) == 6 + 64 for found in hashes)
    assert len(set(hashes)) == len(hashes)


def test_defaults_do_not_count_but_names_keys_and_types_do() -> None:
    def hash_of(name: str = "Probe", field: str = "x", type_: object = int, **options: Any) -> str:
        from msgspec import defstruct

        return type_hash(defstruct(name, [(field, type_, options.pop("default", 0))], **options))

    assert hash_of() == hash_of() == hash_of(default=7)
    others = [
        hash_of(name="Other"),
        hash_of(field="y"),
        hash_of(type_=float),
        hash_of(rename={"x": "z"}),
        hash_of(tag="t"),
        hash_of(array_like=True),
    ]
    assert len({hash_of(), *others}) == len(others) + 1


def test_hash_is_of_the_schema_alone() -> None:
    schema = describe(Point)
    shuffled = {"types": dict(reversed(schema["types"].items())), "root": schema["root"]}
    assert schema_hash(shuffled) == type_hash(Point)
