from bus_bridge.ros2 import type_names
from rows import for_each


@for_each(
    "dds, ros",
    [
        ("std_msgs::msg::dds_::String_", "std_msgs/msg/String"),
        ("pkg2::srv::dds_::S_Request_", "pkg2/srv/S_Request"),
        ("a::action::dds_::F_FeedbackMessage_", "a/action/F_FeedbackMessage"),
    ],
)
def test_types_both_ways(dds: str, ros: str) -> None:
    assert type_names.type_from_dds(dds) == ros
    assert type_names.type_to_dds(ros) == dds


@for_each(
    "dds",
    ["String", "std_msgs::msg::String", "std_msgs::msg::dds_::String", "a::b::dds_::C_", "ü::msg::dds_::C_"],
)
def test_types_that_are_none_of_ros(dds: str) -> None:
    assert type_names.type_from_dds(dds) is None
