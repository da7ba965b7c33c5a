"""Joins and checks namespaces."""

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


def prefix_namespace(base: str | None, namespace: str | None) -> str | None:
    """`namespace` in `base`; an absolute one is in none. Without a namespace, `base`."""
    if namespace is None or base is None:
        found = base if namespace is None else namespace
    elif is_namespace_absolute(namespace):
        found = namespace
    else:
        found = f"{base.rstrip('/')}/{namespace}" if base else namespace
    return found if found is None or found == "/" else found.rstrip("/") or ("/" if found else "")
