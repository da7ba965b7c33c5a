"""`ament_index_python` on the bus: the folders of installed packages, and the resources that they register.

`packages.py` has packages, `resources.py` the resources that they register, `search_paths.py` the prefixes.
Names, errors and order of the search are the same as in ROS 2: the first prefix that has a resource counts.

Read first: `packages.py`. Tests: `tests/unit/bus_ros/ament_index_python/`.
"""

from bus_ros.ament_index_python.constants import RESOURCE_INDEX_SUBFOLDER
from bus_ros.ament_index_python.packages import (
    PackageNotFoundError,
    get_package_prefix,
    get_package_share_directory,
    get_package_share_path,
    get_packages_with_prefixes,
)
from bus_ros.ament_index_python.resources import (
    InvalidResourceNameError,
    InvalidResourceTypeNameError,
    get_resource,
    get_resource_types,
    get_resources,
    has_resource,
)
from bus_ros.ament_index_python.search_paths import get_search_paths

__all__ = [
    "RESOURCE_INDEX_SUBFOLDER",
    "InvalidResourceNameError",
    "InvalidResourceTypeNameError",
    "PackageNotFoundError",
    "get_package_prefix",
    "get_package_share_directory",
    "get_package_share_path",
    "get_packages_with_prefixes",
    "get_resource",
    "get_resource_types",
    "get_resources",
    "get_search_paths",
    "has_resource",
]
