"""Packages that engines need and that may be missing: finds missing ones, and advice for the user."""

import platform
import sys
from importlib.util import find_spec
from typing import NamedTuple

from bus.base.optional import how_to_install

__all__ = ["EXTRAS", "Extra", "why_missing", "why_no_rmw_zenoh"]

_MACHINE = "x86_64"
_FIRST_WITHOUT = (3, 14)


class Extra(NamedTuple):
    """The package that an engine uses."""

    module: str
    distribution: str
    is_limited: bool = False
    """Whether it only has wheels for Linux on x86_64, and up to Python 3.13."""
    is_optional: bool = False
    """Whether the engine works without it, but slower."""


EXTRAS = {
    "zenoh": Extra("zenoh", "eclipse-zenoh"),
    "ros2": Extra("cyclonedds", "cyclonedds", is_limited=True, is_optional=True),
}
"""Packages by the name of the engine."""


def why_missing(engine: str, machine: str | None = None, python: tuple[int, int] | None = None) -> str:
    """A sentence about packages missing for the engine, with advice; "" if nothing is missing.

    `machine` and `python` replace the values of this computer.
    """
    extra = EXTRAS[engine]
    if find_spec(extra.module) is not None:
        return ""
    verb = "is faster with" if extra.is_optional else "needs"
    what = f"a bridge to {engine} {verb} {extra.distribution}"
    machine, python = machine or platform.machine(), python or sys.version_info[:2]
    if extra.is_limited and machine != _MACHINE:
        return f"{what}, of which there is no package for {machine}, only for {_MACHINE}"
    if extra.is_limited and python >= _FIRST_WITHOUT:
        here = ".".join(map(str, python))
        return f"{what}, of which there is no package for Python {here} yet: use 3.13 or older"
    return f"{what}: {how_to_install(extra.distribution)}"


_RMW_ZENOH = ("eclipse-zenoh", "zenoh"), ("xxhash", "xxhash")


def why_no_rmw_zenoh() -> str:
    """A sentence about packages missing for ROS 2 on zenoh, with advice; "" if nothing is missing."""
    missing = [name for name, module in _RMW_ZENOH if find_spec(module) is None]
    if not missing:
        return ""
    return f"a bridge to ROS 2 on zenoh needs {' and '.join(missing)}: {how_to_install(*missing)}"
