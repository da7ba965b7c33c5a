"""Which messages a subscription wants, by what they hold."""

from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["ContentFilterOptions"]


class ContentFilterOptions(NamedTuple):
    """An expression as DDS has them, `speed > 1.5 AND header.frame_id = %0`, and the values of `%0` ..."""

    filter_expression: str = ""
    expression_parameters: Sequence[str] = ()
