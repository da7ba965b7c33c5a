"""Results of callbacks for lifecycle transitions, with the names and numbers of rclpy's enum."""

from enum import Enum

__all__ = ["TransitionCallbackReturnType"]


class TransitionCallbackReturnType(Enum):
    """The result of a transition's callback; programs use it as TransitionCallbackReturn."""

    SUCCESS = 97
    FAILURE = 98
    ERROR = 99

    def to_label(self) -> str:
        """The label of the transition that follows."""
        return f"transition_{self.name.lower()}"

    def __int__(self) -> int:
        return self.value

    __index__ = __int__

    def __str__(self) -> str:
        return f"{type(self).__name__}.{self.name}"
