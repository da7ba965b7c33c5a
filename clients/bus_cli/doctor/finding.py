"""What a look at one subject comes to."""

from typing import NamedTuple

__all__ = ["FULL", "Finding", "fail", "ok", "warn"]

FULL = 0.8
"""The part of a limit from which on a finding warns of it."""


class Finding(NamedTuple):
    """One line: `mark` is ok, warn or fail; `advice` says what to do, where there is something to do."""

    mark: str
    subject: str
    text: str
    advice: str = ""


def ok(subject: str, text: str) -> Finding:
    """As it should be."""
    return Finding("ok", subject, text)


def warn(subject: str, text: str, advice: str = "") -> Finding:
    """The bus works, but not as well as it could, or not for long."""
    return Finding("warn", subject, text, advice)


def fail(subject: str, text: str, advice: str = "") -> Finding:
    """The bus does not work like that."""
    return Finding("fail", subject, text, advice)
