"""bus_ros.rosidl.description: the texts of the files that a message needs."""

from bus_ros.rosidl.description import sources_of
from rows import for_each


@for_each(
    ("name", "needed"),
    [
        ("std_msgs/msg/String", {"std_msgs/msg/String"}),
        ("std_srvs/srv/SetBool_Request", {"std_srvs/srv/SetBool_Request"}),
        (
            "std_srvs/srv/SetBool_Event",
            {
                "std_srvs/srv/SetBool_Event",
                "std_srvs/srv/SetBool_Request",
                "std_srvs/srv/SetBool_Response",
                "service_msgs/msg/ServiceEventInfo",
                "builtin_interfaces/msg/Time",
            },
        ),
        (
            "example_interfaces/action/Fibonacci_FeedbackMessage",
            {
                "example_interfaces/action/Fibonacci_FeedbackMessage",
                "example_interfaces/action/Fibonacci_Feedback",
                "unique_identifier_msgs/msg/UUID",
            },
        ),
    ],
)
def test_the_files_of_a_message(name: str, needed: set[str]) -> None:
    sources = sources_of(name)
    assert {one.type_name for one in sources} == needed
    assert sources[0].type_name == name
    assert all(one.raw_file_contents for one in sources)
    parts = [one for one in sources if "_" in one.type_name.rpartition("/")[2]]
    assert len({one.raw_file_contents for one in parts}) <= 1, "all are in one file"
