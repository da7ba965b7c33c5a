"""Functions for authors of actions and substitutions; programs import it as `launch.utilities`.

The functions are defined in `bus_launch.launch.core`; here are their public names. `type_utils.py` has values
of a type that may be substitutions.

Read first: `type_utils.py`. Tests: `tests/unit/bus_launch/launch/test_core.py`.
"""

from bus_launch.launch.core import (
    ensure_argument_type,
    is_a,
    is_a_subclass,
    normalize_to_list_of_entities,
    normalize_to_list_of_substitutions,
    perform_substitutions,
    visit_all_entities_and_collect_futures,
)

__all__ = [
    "ensure_argument_type",
    "is_a",
    "is_a_subclass",
    "normalize_to_list_of_entities",
    "normalize_to_list_of_substitutions",
    "perform_substitutions",
    "visit_all_entities_and_collect_futures",
]
