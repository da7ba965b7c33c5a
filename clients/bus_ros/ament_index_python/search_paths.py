"""The prefixes to search."""

from bus_ros import packages

__all__ = ["get_search_paths"]


def get_search_paths() -> list[str]:
    """The existing prefixes, in order of the search.

    First come the prefixes of $AMENT_PREFIX_PATH, then the built workspace around the current folder, then
    the prefix of this Python. So there is always one, unlike in ROS 2.
    """
    return list(dict.fromkeys(str(one.path) for one in packages.prefixes() if one.path.is_dir()))
