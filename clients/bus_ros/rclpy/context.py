"""Contexts: `rclpy.init` begins one, `rclpy.shutdown` ends it. Owns arguments, and the calls at its end."""

import sys
from collections.abc import Callable, Sequence
from threading import Lock, Thread, get_ident
from types import TracebackType
from typing import Protocol
from weakref import WeakKeyDictionary, WeakSet

from bus.errors import ConfigurationError
from bus.logger import configure, get_logger
from bus.parameters import file
from bus.process.address import domain_id
from bus.process.ros_args import Arguments, UnknownArguments
from bus_ros import engine as engines
from bus_ros.rclpy.destroyable import Handle
from bus_ros.rclpy.exceptions import RCLError, RCLInvalidROSArgsError, UnknownROSArgsError

__all__ = ["Context", "get_default_context"]

_INVALID = "Failed to parse ROS arguments: "


class _Node(Protocol):
    """The interface of a node for its context."""

    def destroy_node(self) -> None: ...


class _Runner(Protocol):
    """The interface of a running AsyncNode for its context."""

    def context_ended(self) -> None:
        """The context ends. Called in any thread, and in a signal's handler."""


class Context:
    """A life of the facade, from `init` to `shutdown`. `with` initializes it, and its end shuts it down."""

    def __init__(self) -> None:
        self._lock = Lock()
        self.is_valid = False
        self.was_ended_by_signal = False
        self.domain_id: int | None = None
        """As given to `init`; None: from the environment."""
        self._callbacks: list[Callable[[], object]] = []
        self._sleepers: WeakSet[engines.Sleeper] = WeakSet()
        self._nodes: WeakKeyDictionary[_Node, int] = WeakKeyDictionary()  # with their threads
        self._runners: WeakSet[_Runner] = WeakSet()
        self._is_destroyed = False
        self._handle: Handle | None = None
        self.arguments: tuple[str, ...] = ()
        self.parameters: tuple[file.Section, ...] = ()
        _contexts.add(self)

    @property
    def handle(self) -> Handle | None:
        """The handle for programs that use rclpy's handles; None before `init`."""
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
        """Begin. `args`: the command line, by default the program's own. Its ROS arguments follow --ros-args.

        Raises RuntimeError if it has begun already. Raises UnknownROSArgsError, and RCLError for other
        invalid ROS arguments; both are RuntimeErrors. Raises UnicodeEncodeError for an argument whose bytes
        are not UTF-8.
        """
        words = tuple(sys.argv[1:] if args is None else args)
        for word in words:
            word.encode()
        try:
            arguments, parameters = parse_arguments(words)
        except RCLInvalidROSArgsError as error:
            reason = str(error).removeprefix(_INVALID)
            raise RCLError(f"failed to initialize rcl: {reason}") from None
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
        """Whether it has begun and not ended. Raises InvalidHandle after `destroy`."""
        if self._is_destroyed and self._handle is not None:
            self._handle.check()
        return self.is_valid

    def get_domain_id(self) -> int:
        """The domain of its bus: `--domain` of busd.

        Raises RuntimeError before `init`, RCLError after the end.
        """
        if not self.is_valid:
            if self._handle is not None:
                raise RCLError("Failed to get domain id")
            raise RuntimeError("Context must be initialized before it can have a domain id")
        return domain_id(self.domain_id)

    def shutdown(self) -> None:
        """End: `spin` returns. A second call is an error, unless a signal came first.

        Raises RuntimeError if it has not begun or has ended.
        """
        if not self._end() and not self._forgive():
            if self._handle is not None and self is not _default:  # rclpy replaces the default one
                raise RCLError("failed to shutdown: rcl_shutdown already called on the given context")
            raise RuntimeError("Context must be initialized before it can be shutdown")

    def try_shutdown(self) -> None:
        """End, unless it has ended already."""
        self._end()

    def destroy(self) -> None:
        """End it for good; a second call does nothing."""
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
        """All contexts in use."""
        return list(_contexts)

    def nodes(self) -> list[_Node]:
        """Existing nodes that were made in it."""
        # Not by iteration, which another thread may disturb.
        return [node for one in self._nodes.keyrefs() if (node := one()) is not None]

    def nodes_of_this_thread(self) -> set[_Node]:
        """Existing nodes that the calling thread made in it."""
        return {node for node in self.nodes() if self._nodes[node] == get_ident()}

    def track_node(self, node: _Node) -> None:
        self._nodes[node] = get_ident()

    def notify_at_end(self, runner: _Runner) -> None:
        """Call its `context_ended` at the end; it is not kept alive."""
        self._runners.add(runner)

    def wake_at_end(self, sleeper: engines.Sleeper) -> None:
        """Call its `wake_up` at the end; it is not kept alive. Under the engine's guard."""
        self._sleepers.add(sleeper)

    def end_by_signal(self) -> None:
        """In a signal's handler: end; other threads do the work that needs locks."""
        if self.is_valid:
            self.is_valid = False
            self.was_ended_by_signal = True
            self._notify_runners()
            if engine := engines.current():
                engine.loop.call_soon_threadsafe(self._wake_all)
                engine.nudge()
            if self._callbacks:
                Thread(target=self._call_back, name="rclpy shutdown", daemon=True).start()

    def _forgive(self) -> bool:
        """Whether a second shutdown is allowed: after a signal, it is not a program's mistake."""
        forgiven, self.was_ended_by_signal = self.was_ended_by_signal, False
        return forgiven

    def _end(self) -> bool:
        with self._lock:
            was_valid, self.is_valid = self.is_valid, False
        if was_valid:
            self._notify_runners()
            if engine := engines.current():
                engine.call(self._wake_all)
            self._call_back()
        return was_valid

    def _wake_all(self) -> None:
        for sleeper in tuple(self._sleepers):
            sleeper.wake_up()

    def _notify_runners(self) -> None:
        for runner in tuple(self._runners):
            runner.context_ended()

    def _call_back(self) -> None:
        with self._lock:
            callbacks, self._callbacks = self._callbacks, []
        for callback in callbacks:
            try:
                callback()
            except Exception as error:
                get_logger("rclpy").error(f"a shutdown callback raised {type(error).__name__}: {error}")


def parse_arguments(words: Sequence[str]) -> tuple[Arguments, tuple[file.Section, ...]]:
    """The arguments of a command line, and its parameters.

    Raises UnknownROSArgsError, and RCLInvalidROSArgsError for other invalid arguments.
    """
    try:
        arguments = Arguments.parse(words)
        return arguments, file.load(arguments.parameters) if arguments.parameters else ()
    except ConfigurationError as error:
        kind = UnknownROSArgsError if isinstance(error, UnknownArguments) else RCLInvalidROSArgsError
        raise kind(f"{_INVALID}{error}") from None


_contexts: WeakSet[Context] = WeakSet()
_default = Context()


def get_default_context(*, shutting_down: bool = False) -> Context:
    """The context for calls without one."""
    return _default
