"""bus_bridge.ros2.service_hash: hashes of services as ROS 2 and pyzeros have them."""

from bus_bridge.ros2.service_types import ServiceTypes
from rows import for_each


@for_each(
    ("type_name", "type_hash"),
    [
        (
            "std_srvs/srv/SetBool",
            "RIHS01_abe9e4bb6b41b40e6789712c00ec8871923e089af3f667a79992a428cff2da0a",
        ),
        (
            "example_interfaces/srv/AddTwoInts",
            "RIHS01_e118de6bf5eeb66a2491b5bda11202e7b68f198d6f67922cf30364858239c81a",
        ),
        (
            "rcl_interfaces/srv/ListParameters",
            "RIHS01_3e6062bfbb27bfb8730d4cef2558221f51a11646d78e7bb30a1e83afac3aad9d",
        ),
    ],
)
def test_hashes(type_name: str, type_hash: str) -> None:
    assert ServiceTypes.find(type_name).type_hash == type_hash
