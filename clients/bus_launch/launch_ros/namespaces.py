"""Names put together."""

__all__ = [
    "is_namespace_absolute",
    "is_root_namespace",
    "make_namespace_absolute",
    "prefix_namespace",
]


def is_root_namespace(namespace: str) -> bool:
    return namespace == "/"


def is_namespace_absolute(namespace: str) -> bool:
    return namespace.startswith("/")


def make_namespace_absolute(namespace: str | None) -> str:
    return "/" + (namespace or "").strip("/")


def prefix_namespace(base: str | None, namespace: str | None) -> str:
    """`namespace` in `base`; an absolute one is in none."""
    if namespace is None:
        return base or "/"
    if not base or is_namespace_absolute(namespace):
        return namespace
    return f"{base.rstrip('/')}/{namespace}".rstrip("/") or "/"
