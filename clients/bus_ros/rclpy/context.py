"""Contexts: `rclpy.init` begins one, `rclpy.shutdown` ends it. Owns arguments, and the calls at its end."""

import sys
from collections.abc import Callable, Sequence
from threading import Lock, Thread
from types import TracebackType
from typing import Protocol
from weakref import WeakSet

from bus.errors import ConfigurationError
from bus.logger import configure, get_logger
from bus.parameters import file
from bus.process.address import domain_id
from bus.process.ros_args import Arguments, UnknownArguments
from bus_ros import engine as engines
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.exceptions import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError

__all__ = ["Context", "get_default_context"]


class _Node(Protocol):
    """A node as its context sees it."""

    def destroy_node(self) -> None: ...


class Context:
    """A life of the facade, from `init` to `shutdown`. In a `with`, entering begins and leaving ends it."""

    def __init__(self) -> None:
        self._lock = Lock()
        self.is_valid = False
        self.was_ended_by_signal = False
        self.domain_id: int | None = None
        """As given to `init`; None = as the environment says."""
        self._callbacks: list[Callable[[], object]] = []
        self._sleepers: WeakSet[engines.Sleeper] = WeakSet()
        self._nodes: WeakSet[_Node] = WeakSet()
        self._is_destroyed = False
        self._handle: Handle | None = None
        self.arguments: tuple[str, ...] = ()
        self.parameters: tuple[file.Section, ...] = ()
        _contexts.add(self)

    @property
    def handle(self) -> Handle | None:
        """For programs that enter rclpy's handles; None before `init`."""
        return self._handle

    def __enter__(self) -> "Context":
        if not self.is_valid:
            self.init()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.try_shutdown()

    def init(
        self,
        args: Sequence[str] | None = None,
        *,
        initialize_logging: bool = True,
        domain_id: int | None = None,
    ) -> None:
        """Begin. `args`: the command line, by default the program's own; those after --ros-args are obeyed.

        Raises RuntimeError where it has begun already; RCLInvalidROSArgsError or UnknownROSArgsError, which
        are RuntimeErrors, for ROS arguments that can't be used.
        """
        words = tuple(sys.argv[1:] if args is None else args)
        arguments, parameters = parse_arguments(words)
        if domain_id is not None and domain_id < 0:
            raise RuntimeError(f"Domain id ({domain_id}) should not be lower than zero.")
        with self._lock:
            if self.is_valid or self._is_destroyed:
                raise RuntimeError("Context.init() must only be called once")
            self.arguments = words
            self.parameters = parameters
            self.domain_id = domain_id
            self.was_ended_by_signal = False
            self.is_valid = True
            self._handle = Handle(lambda: self._is_destroyed, self.destroy)
        if initialize_logging:
            configure(arguments)

    def ok(self) -> bool:
        """Whether it has begun and not ended. Raises InvalidHandle once it is destroyed."""
        if self._is_destroyed and self._handle is not None:
            self._handle.check()
        return self.is_valid

    def get_domain_id(self) -> int:
        """The bus it is on: `--domain` of busd. Raises RuntimeError before `init`, RCLError after the end."""
        if not self.is_valid:
            if self._handle is not None:
                raise RCLError("Failed to get domain id")
            raise RuntimeError("Context must be initialized before it can have a domain id")
        return domain_id(self.domain_id)

    def shutdown(self) -> None:
        """End: `spin` returns. Once more is an error, unless a signal was first.

        Raises RuntimeError where it has not begun or has ended.
        """
        if not self._end() and not self._forgive():
            if self._handle is not None and self is not _default:  # of which rclpy makes a new one
                raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")
            raise RuntimeError("Context must be initialized before it can be shutdown")

    def try_shutdown(self) -> None:
        """End, where that has not happened."""
        self._end()

    def destroy(self) -> None:
        """End it for good; once more does nothing."""
        self._end()
        self._is_destroyed = True

    def on_shutdown(self, callback: Callable[[], object]) -> None:
        """Call `callback` when it ends."""
        if not callable(callback):
            raise TypeError(f"callback must be callable, not {type(callback).__name__}")
        with self._lock:
            self._callbacks.append(callback)

    @classmethod
    def all(cls) -> "list[Context]":
        """Those that are in use."""
        return list(_contexts)

    def nodes(self) -> list[_Node]:
        """Those that were made in it and still exist."""
        return list(self._nodes)

    def track_node(self, node: _Node) -> None:
        self._nodes.add(node)

    def wake_at_end(self, sleeper: engines.Sleeper) -> None:
        """Call its `wake_up` at the end; it is not kept alive. Under the engine's guard."""
        self._sleepers.add(sleeper)

    def end_by_signal(self) -> None:
        """In a signal's handler: end; other threads do what takes locks."""
        if self.is_valid:
            self.is_valid = False
            self.was_ended_by_signal = True
            if engine := engines.current():
                engine.loop.call_soon_threadsafe(self._wake_all)
                engine.nudge()
            if self._callbacks:
                Thread(target=self._call_back, name="rclpy shutdown", daemon=True).start()

    def _forgive(self) -> bool:
        """After a signal, programs shut down what is shut down already; that is no mistake of theirs."""
        forgiven, self.was_ended_by_signal = self.was_ended_by_signal, False
        return forgiven

    def _end(self) -> bool:
        with self._lock:
            was_valid, self.is_valid = self.is_valid, False
        if was_valid:
            if engine := engines.current():
                engine.call(self._wake_all)
            self._call_back()
        return was_valid

    def _wake_all(self) -> None:
        for sleeper in tuple(self._sleepers):
            sleeper.wake_up()

    def _call_back(self) -> None:
        with self._lock:
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            try:
                callback()
            except Exception as error:
                get_logger("rclpy").error(f"a shutdown callback raised {type(error).__name__}: {error}")


def parse_arguments(words: Sequence[str]) -> tuple[Arguments, tuple[file.Section, ...]]:
    """A command line's arguments, and its parameters.

    Raises UnknownROSArgsError, and RCLInvalidROSArgsError for others that can't be used.
    """
    try:
        arguments = Arguments.parse(words)
        return arguments, file.load(arguments.parameters) if arguments.parameters else ()
    except ConfigurationError as error:
        kind = UnknownROSArgsError if isinstance(error, UnknownArguments) else RCLInvalidROSArgsError
        raise kind(f"Failed to parse ROS arguments: {error}") from None


_contexts: WeakSet[Context] = WeakSet()
_default = Context()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """The context for calls that name none."""
    return _default
