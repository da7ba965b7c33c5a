"""Where is searched."""

from bus_ros import packages

__all__ = ["get_search_paths"]


def get_search_paths() -> list[str]:
    """The prefixes that are there, the first to be used first.

    Those of $AMENT_PREFIX_PATH, those of the built workspace around the current folder, and that of this
    Python: unlike in ROS 2, there is always one.
    """
    return list(dict.fromkeys(str(one.path) for one in packages.prefixes() if one.path.is_dir()))
