"""Remap rules of nodes, as launch files write them: pairs of names, which may be substitutions."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

from bus_launch.launch.core import Substitution, normalize_to_list_of_substitutions

__all__ = ["RemapRule", "normalize_remap_rule", "normalize_remap_rules"]

RemapRule = tuple[list[Substitution], list[Substitution]]


def normalize_remap_rule(remap_rule: Any) -> RemapRule:
    """A pair of a name and its replacement. Raises TypeError if it is no tuple of two."""
    if not isinstance(remap_rule, tuple) or len(remap_rule) != 2:
        raise TypeError(f"a remap rule is a tuple (name, new name), not {remap_rule!r}")
    old, new = remap_rule
    return normalize_to_list_of_substitutions(old), normalize_to_list_of_substitutions(new)


def normalize_remap_rules(remap_rules: Iterable[Any]) -> Iterator[RemapRule]:
    """As `normalize_remap_rule`, for several. Raises TypeError also for a dict."""
    if isinstance(remap_rules, str | Mapping):
        raise TypeError(f"remappings are a list of tuples (name, new name), not {remap_rules!r}")
    return map(normalize_remap_rule, remap_rules)
