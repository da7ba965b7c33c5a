"""Names of the ament index."""

__all__ = ["AMENT_PREFIX_PATH_ENV_VAR", "RESOURCE_INDEX_SUBFOLDER"]

RESOURCE_INDEX_SUBFOLDER = "share/ament_index/resource_index"
"""A path relative to a prefix: it has a folder for each type of resource, with a file for each resource."""

AMENT_PREFIX_PATH_ENV_VAR = "AMENT_PREFIX_PATH"
