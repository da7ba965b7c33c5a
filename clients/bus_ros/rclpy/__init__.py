"""rclpy on the bus: the modules that programs written for ROS 2's Python client library import as `rclpy`.

Never installed under that name: `bus run` and `import bus.rclpy_compat` let programs import it. The functions
here use the default context and one executor for all. Submodules become attributes at their first use.

    `node.py` --> `publisher.py`, `subscription.py`, `service.py`, `client.py`, `timer.py`, `action/`
                       | an entity (`bus_ros.entity`) has a call to make: it joins the executor's line, once
    `executors.py` --> takes the next call under the guard, makes it without the guard
                       | waits
    `bus_ros.engine`   runs the event loop meanwhile

Invariants:

- User callbacks run without the guard, and never in the event loop.
- A subscription of a node that does not spin keeps its `depth` newest messages and no more.
- KeyboardInterrupt is never raised while the guard is held (`signals.py`).
- Names that rclpy does not have are private or in `impl/`; names that rclpy has in two places are in
  `bus_ros.aliases`. A new name needs a row in docs/rclpy.md.
- `tests/system/test_first_message.py` limits the modules that `import rclpy` imports.

Read first: `executors.py`, then `node.py`.

Tests: `tests/unit/bus_ros/rclpy/`, `tests/system/test_rclpy_executors.py`,
`tests/system/test_rclpy_programs.py`, `tests/system/test_rclpy_threads.py`, `tests/unit/test_docs_rclpy.py`.
"""

import _thread
import atexit
import os
import signal
import sys
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from importlib import import_module
from importlib.util import find_spec
from time import sleep
from types import TracebackType
from typing import Any

from bus.base.loading import except_hook, loading

with loading():
    from bus.process.termination import die_at_exit
    from bus_ros import aliases
    from bus_ros import engine as engines
    from bus_ros.rclpy import signals
    from bus_ros.rclpy.context import Context, get_default_context
    from bus_ros.rclpy.exceptions import ROSInterruptException
    from bus_ros.rclpy.executors import Executor, ExternalShutdownException, SingleThreadedExecutor
    from bus_ros.rclpy.node import Node
    from bus_ros.rclpy.parameter import Parameter
    from bus_ros.rclpy.signals import SignalHandlerOptions
    from bus_ros.rclpy.task import Future
    from bus_ros.rclpy.utilities import get_rmw_implementation_identifier, ok

__all__ = [
    "InitContextManager",
    "create_node",
    "get_default_context",
    "get_global_executor",
    "get_rmw_implementation_identifier",
    "init",
    "ok",
    "shutdown",
    "spin",
    "spin_once",
    "spin_until_future_complete",
    "try_shutdown",
]

aliases.install()

_executor: Executor | None = None
_ENDS = (ExternalShutdownException, ROSInterruptException)
"""Errors that waiting calls raise at the end of the context."""
_SOON_S = 0.001


class InitContextManager:
    """The result of `init`: leaving the `with` shuts the context down, unless that has been done."""

    def __init__(self, context: Context) -> None:
        self.context = context

    def __enter__(self) -> "InitContextManager":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        try_shutdown(context=self.context)


def init(
    *,
    args: Sequence[str] | None = None,
    context: Context | None = None,
    domain_id: int | None = None,
    signal_handler_options: SignalHandlerOptions | None = None,
) -> InitContextManager:
    """Initialize a context, before nodes are made. `args`: the command line, by default the program's own.

    With the default context, Ctrl-C raises KeyboardInterrupt out of `spin` and out of the program's own code,
    and SIGTERM raises ExternalShutdownException out of `spin`; `signal_handler_options` changes this.

    Raises RuntimeError if the context is initialized already, or if ROS arguments are invalid.
    """
    is_default = context is None or context is get_default_context()
    context = context or get_default_context()
    context.init(args, domain_id=domain_id)
    if signal_handler_options is None:
        signal_handler_options = SignalHandlerOptions.ALL if is_default else SignalHandlerOptions.NO
    signals.install_signal_handlers(signal_handler_options)
    if sys.excepthook in (sys.__excepthook__, except_hook):
        sys.excepthook = _say_what_ended_it
    if threading.excepthook is threading.__excepthook__:
        threading.excepthook = _say_what_ended_a_thread
    if sys.unraisablehook is sys.__unraisablehook__:
        sys.unraisablehook = _say_what_was_ignored
    return InitContextManager(context)


def shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut the context down. Raises RuntimeError if it is already; not the first time after a signal."""
    _end(context, uninstall_handlers, (context or get_default_context()).shutdown)


def try_shutdown(*, context: Context | None = None, uninstall_handlers: bool | None = None) -> None:
    """Shut the context down, unless it is already."""
    _end(context, uninstall_handlers, (context or get_default_context()).try_shutdown)


def create_node(  # noqa: PLR0913
    node_name: str,
    *,
    context: Context | None = None,
    cli_args: Sequence[str] | None = None,
    namespace: str | None = None,
    use_global_arguments: bool = True,
    enable_rosout: bool = True,
    start_parameter_services: bool = True,
    parameter_overrides: list[Parameter] | None = None,
    allow_undeclared_parameters: bool = False,
    automatically_declare_parameters_from_overrides: bool = False,
    enable_logger_service: bool = False,
) -> Node:
    """Make a `Node`."""
    return Node(
        node_name,
        context=context,
        cli_args=cli_args,
        namespace=namespace,
        use_global_arguments=use_global_arguments,
        enable_rosout=enable_rosout,
        start_parameter_services=start_parameter_services,
        parameter_overrides=parameter_overrides,
        allow_undeclared_parameters=allow_undeclared_parameters,
        automatically_declare_parameters_from_overrides=automatically_declare_parameters_from_overrides,
        enable_logger_service=enable_logger_service,
    )


def get_global_executor() -> Executor:
    """The executor for calls without one."""
    global _executor
    if _executor is None or _executor.is_shutdown:
        _executor = SingleThreadedExecutor()
    return _executor


def spin(node: Node, executor: Executor | None = None) -> None:
    """Call the node's callbacks until the context is shut down; see `Executor.spin`."""
    with _working_for(node, executor or get_global_executor()) as executor:
        executor.spin()


def spin_once(node: Node, *, executor: Executor | None = None, timeout_sec: float | None = None) -> None:
    """Wait for one callback of the node and call it; see `Executor.spin_once`."""
    with _working_for(node, executor or get_global_executor()) as executor:
        executor.spin_once(timeout_sec=timeout_sec)


def spin_until_future_complete(
    node: Node, future: Future[Any], executor: Executor | None = None, timeout_sec: float | None = None
) -> None:
    """Call the node's callbacks until `future` is done; see `Executor.spin_until_future_complete`."""
    with _working_for(node, executor or get_global_executor()) as executor:
        executor.spin_until_future_complete(future, timeout_sec)


@contextmanager
def _working_for(node: Node, executor: Executor) -> Iterator[Executor]:
    """Let the executor work for the node; then remove it, unless it was there before (a nested spin)."""
    if not isinstance(node, Node):
        raise TypeError(f"a node is needed here, not {node!r:.80}")
    is_new = executor.add_node(node)
    try:
        yield executor
    finally:
        if is_new:
            executor.remove_node(node)


def _end(context: Context | None, uninstall_handlers: bool | None, end: Any) -> None:
    global _executor
    is_default = context is None or context is get_default_context()
    try:
        end()
    finally:
        if uninstall_handlers or (uninstall_handlers is None and is_default):
            signals.uninstall_signal_handlers()
        if is_default and _executor is not None:
            _executor.shutdown()
            _executor = None


def _say_what_ended_it(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    """Let the program die by the signal, without a traceback: Ctrl-C and SIGTERM are not its mistakes."""
    number = signals.last_signal()
    if issubclass(kind, _ENDS) and number is not None:
        die_at_exit(number)
    elif not issubclass(kind, KeyboardInterrupt):  # Python itself handles it like that
        sys.__excepthook__(kind, error, trace)


def _say_what_ended_a_thread(end: threading.ExceptHookArgs) -> None:
    if not issubclass(end.exc_type, _ENDS):
        threading.__excepthook__(end)


def _say_what_was_ignored(what: "sys.UnraisableHookArgs") -> None:
    """Raise an interrupt again that came in a destructor, where Python ignores it.

    No message if it came while Python waits for its threads at the end.
    """
    if not issubclass(what.exc_type, KeyboardInterrupt):
        sys.__unraisablehook__(what)
    elif what.object is not threading:
        _thread.start_new_thread(_interrupt_soon, ())  # raised here, Python would ignore it, too


def _interrupt_soon() -> None:
    sleep(_SOON_S)
    if main := threading.main_thread().ident:
        signal.pthread_kill(main, signal.SIGINT)


@atexit.register
def _leave() -> None:
    """Destroy the nodes that the program has left open, which also hands over their published messages."""
    with suppress(ValueError):  # not in the main thread
        signal.signal(signal.SIGINT, signal.SIG_IGN)  # a second Ctrl-C does not cut this short; CLOSE_S does
    if engine := engines.current():
        engine.loop.is_interrupted = False
    # The program's daemon threads go on, and the destroyed nodes make them raise errors.
    threading.excepthook = lambda _: None
    for context in Context.all():
        for node in context.nodes():
            assert isinstance(node, Node)
            Node.destroy_node(node)  # not a subclass's method, which rclpy would not call at the end
    engines.end()


def _forked() -> None:
    global _executor
    _executor = None


os.register_at_fork(after_in_child=_forked)


def __getattr__(name: str) -> Any:
    if not name.startswith("_") and find_spec(f"bus_ros.rclpy.{name}") is not None:
        return import_module(f"bus_ros.rclpy.{name}")
    raise AttributeError(f"module 'rclpy' has no attribute {name!r}")
