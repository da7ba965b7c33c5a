"""The result of one check."""

from typing import NamedTuple

__all__ = ["FULL", "Finding", "fail", "ok", "warn"]

FULL = 0.8
"""Findings warn above this part of a limit."""


class Finding(NamedTuple):
    """One line: `mark` is ok, warn or fail; `advice` tells the user what to do, or is empty."""

    mark: str
    subject: str
    text: str
    advice: str = ""


def ok(subject: str, text: str) -> Finding:
    """A finding without a problem."""
    return Finding("ok", subject, text)


def warn(subject: str, text: str, advice: str = "") -> Finding:
    """A problem with which the bus still works, but worse than it could, or not for long."""
    return Finding("warn", subject, text, advice)


def fail(subject: str, text: str, advice: str = "") -> Finding:
    """A problem with which the bus does not work."""
    return Finding("fail", subject, text, advice)
