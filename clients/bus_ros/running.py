"""Runs a program as Python, or the shell, would.

Scripts, modules and console scripts run in this process, with ROS 2's modules filled in if they are missing;
other programs are children. Owns the changes to this interpreter that a program expects: `sys.argv`,
`sys.path`, `__main__`, tracebacks, exit codes. Must not know command lines or the folders of packages.
"""

# pathlib would add milliseconds to the start of each script:
# ruff: noqa: PTH109, PTH112, PTH118, PTH120, PTH123
import builtins
import os
import sys
from collections.abc import Callable, Sequence
from types import ModuleType, TracebackType
from typing import Any, NoReturn

from bus.process.start_errors import START_ERRORS, text_of
from bus.process.termination import die_at_interrupt, heed_interrupts, is_dying

__all__ = [
    "add_paths",
    "fill_in",
    "is_python",
    "run_child",
    "run_entry_point",
    "run_module",
    "run_script",
]

_HOOK = "bus_ros.import_hook"
_SI_USER = 0


def fill_in(*, force: bool) -> None:
    """Make ROS 2's modules importable if they are missing; with `force`, ahead of real ones."""
    if force:
        os.environ["BUS_RCLPY_FORCE"] = "1"  # for child processes
    from bus_ros.import_hook import install

    install(force=force)


def run_script(path: str, arguments: Sequence[str], *, of_package: bool = False) -> NoReturn:
    """`python path arguments`; `path` may also be a folder or archive with a `__main__.py`.

    `of_package`: on failure, print the line that ros2 run prints. Raises OSError if the file can't be read,
    before anything is run.
    """
    full = os.path.join(os.getcwd(), path)
    sys.argv = [path, *arguments]
    if os.path.isdir(full) or full.endswith((".pyz", ".zip")):
        _set_first_path(full)
        _run(lambda: _run_as_main("__main__", alter_argv=False), of_package=of_package)
    with open(full, "rb") as file:
        source = file.read()
    from importlib.machinery import SourceFileLoader

    _set_first_path(os.path.dirname(os.path.realpath(full)))
    main = _new_main(__file__=full, __cached__=None, __loader__=SourceFileLoader("__main__", full))

    def call() -> None:
        code = compile(source, full, "exec", dont_inherit=True)
        heed_interrupts()
        exec(code, main)

    _run(call, of_package=of_package)


def run_module(name: str, arguments: Sequence[str]) -> NoReturn:
    """`python -m name arguments`."""
    _set_first_path(os.getcwd())
    sys.argv = ["-m", *arguments]  # runpy replaces it by the module's file
    _run(lambda: _run_as_main(name, alter_argv=True))


def run_entry_point(target: str, path: str, arguments: Sequence[str], *, of_package: bool = True) -> NoReturn:
    """Call `module:function` as the console script at `path` would; `of_package` as for `run_script`."""
    module, _, function = target.partition(":")
    _set_first_path(os.path.dirname(path))
    sys.argv = [path, *arguments]
    _new_main(__file__=path)

    def call() -> Any:
        is_ours = module.startswith("bus_")  # busd's own programs begin only at the call
        if not is_ours:
            heed_interrupts()
        # Python shows no frames of the import system for a failing import statement, but does for
        # import_module.
        __import__(module)
        found: Any = sys.modules[module]
        for name in function.split("."):
            found = getattr(found, name)
        if is_ours:
            heed_interrupts()
        return found()

    _run(call, of_package=of_package)


def run_child(command: Sequence[str], *, of_package: bool = False) -> int:
    """Run a program to its end as a child, with our environment and terminal; returns its exit code.

    If SIGINT, SIGTERM or SIGHUP ended it, the code is minus the signal's number: the caller can then die by
    the same signal. For other signals it is 128 plus the number, as in a shell. Signals sent to this process
    reach the child too. Raises OSError if the program can't be executed.
    """
    import signal

    signals = {signal.SIGINT, signal.SIGQUIT, signal.SIGTERM, signal.SIGHUP, signal.SIGCHLD}
    mask = signal.pthread_sigmask(signal.SIG_BLOCK, signals)
    try:
        # Python ignores SIGPIPE, but programs expect the default.
        child = os.posix_spawnp(
            command[0], list(command), os.environ, setsigmask=mask, setsigdef=[signal.SIGPIPE, signal.SIGXFSZ]
        )
        while True:
            told = signal.sigwaitinfo(signals)
            if told.si_signo == signal.SIGCHLD:
                ended, status = os.waitpid(child, os.WNOHANG)
                if ended:
                    break
            elif told.si_code <= _SI_USER:  # else the terminal sent it, and to the child as well
                os.kill(child, told.si_signo)
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, mask)
    code = os.waitstatus_to_exitcode(status)
    if of_package:
        _say_failure(code)
    if code >= 0 or -code in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        return code
    return 128 - code  # dying by the signal would write a core file of this process


def is_python(path: str) -> bool:
    """Whether a file is a program in Python, by its name or its first line."""
    if path.endswith(".py"):
        return True
    try:
        with open(path, "rb") as file:
            line = file.readline(256)
    except OSError:
        return False
    return line.startswith(b"#!") and b"python" in line


def add_paths(folders: Sequence[str]) -> None:
    """Make the packages in `folders` importable, here and in children.

    The targets of .pth files in them, as editable installs have them, become importable, too.
    """
    import site

    first, *before = sys.path
    sys.path[:] = before  # the first is the folder of `bus`, not the program's
    for folder in folders:
        site.addsitedir(folder)
    added = [path for path in sys.path if path not in before]
    sys.path[:] = [first, *added, *before]
    old = os.environ.get("PYTHONPATH")
    os.environ["PYTHONPATH"] = os.pathsep.join([*added, old] if old else added)


def _set_first_path(folder: str) -> None:
    if not sys.flags.safe_path:
        sys.path[0] = folder
    elif not os.environ.get("PYTHONSAFEPATH"):  # -P is set for our own program, not the user's
        sys.path.insert(0, folder)


def _new_main(**values: Any) -> dict[str, Any]:
    main = ModuleType("__main__")
    main.__dict__.update(__builtins__=builtins, **values)
    sys.modules["__main__"] = main
    return main.__dict__


def _run_as_main(name: str, *, alter_argv: bool) -> None:
    import runpy

    _new_main()
    heed_interrupts()
    runpy._run_module_as_main(name, alter_argv)  # type: ignore[attr-defined]


def _run(body: Callable[[], Any], *, of_package: bool = False) -> NoReturn:
    """Run a program's body and end as Python would, but show an error of the start in one line."""
    try:
        code = body()
    except SystemExit as end:
        code = end.code
    except KeyboardInterrupt:
        # The silent exception hook does this too, but would show a second Ctrl-C that comes as it begins.
        die_at_interrupt()
        raise
    except BaseException as error:
        if isinstance(error, START_ERRORS):
            print(text_of(error), file=sys.stderr)  # as bus.run does
        else:
            _show(error)
        code = 1
    if of_package and code is not None and not is_dying():
        if not isinstance(code, int):
            print(code, file=sys.stderr)
            code = 1
        _say_failure(code)
    raise SystemExit(code) from None


def _show(error: BaseException) -> None:
    """Hand an uncaught error to `sys.excepthook`, without our own frames."""
    trace = error.__traceback__
    while trace is not None and trace.tb_frame.f_code.co_filename == __file__:
        trace = trace.tb_next
    if isinstance(error, ImportError):
        _cut_hook(trace)
    sys.excepthook(type(error), error.with_traceback(trace), trace)


def _cut_hook(trace: TracebackType | None) -> None:
    hook = sys.modules.get(_HOOK)
    while trace is not None:
        below = trace.tb_next
        if hook and below is not None and below.tb_frame.f_code.co_filename == hook.__file__:
            trace.tb_next = None
        trace = trace.tb_next


def _say_failure(code: int) -> None:
    """Print the failure as ros2 run does, except for Ctrl-C. A signal has a negative `code`."""
    if not code or code == -2:
        return
    sys.stdout.flush()
    if code > 0:
        text = f"Process exited with failure {code}"
    else:
        import signal

        text = signal.strsignal(-code) or f"Signal {-code}"
    print(f"[ros2run]: {text}", file=sys.stderr, flush=True)
