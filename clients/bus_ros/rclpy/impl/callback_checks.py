"""Checks that an entity can call a callback with its arguments. Must know only functions."""

from collections.abc import Callable

from bus.base.callbacks import takes

__all__ = ["check_arguments", "check_callback"]


def check_callback(callback: object) -> None:
    if not callable(callback):
        raise TypeError(f"callback must be callable, not {type(callback).__name__}")


def check_arguments(callback: Callable[..., object]) -> None:
    """Check a subscription's callback. Raises RuntimeError, with rclpy's text."""
    if takes(callback, 1) or takes(callback, 2):
        return
    raise RuntimeError(
        "Subscription.__init__(): callback should be either be callable with one argument"
        "(to get only the message) or two (to get message and message info)"
    )
