"""A subscription's filter by the contents of messages."""

from collections.abc import Sequence
from typing import NamedTuple

__all__ = ["ContentFilterOptions"]


class ContentFilterOptions(NamedTuple):
    """An expression as in DDS, `speed > 1.5 AND header.frame_id = %0`, and the values of `%0` ..."""

    filter_expression: str = ""
    expression_parameters: Sequence[str] = ()
