"""The output of a launch: screen and log files; programs import it as `launch.logging`.

Owns: the screen, which is stdout, and the log files below `~/.ros/log` (or $ROS_LOG_DIR, $ROS_HOME/log). Must
not know: processes. A line that can't be written is no error; if the reader of stdout is gone,
`launch_config.on_closed_screen` is called.
"""

import logging
import os
import socket
import sys
from collections.abc import Callable, Mapping
from datetime import datetime
from pathlib import Path
from typing import Any, Final

__all__ = ["get_logger", "get_output_loggers", "launch_config", "log_launch_config", "reset"]

_SCREEN: Final = {
    "default": "[{levelname}] [{name}]: {message}",
    "default_with_timestamp": "{created:.7f} [{levelname}] [{name}]: {message}",
}
_FILE: Final = {"default": _SCREEN["default_with_timestamp"]}
_SCREEN_VARIABLE: Final = "OVERRIDE_LAUNCH_SCREEN_FORMAT"
_FILE_VARIABLE: Final = "OVERRIDE_LAUNCH_LOG_FORMAT"
_LINE: Final = "{message}"
_LINE_IN_FILE: Final = "{created:.7f} {message}"
_FILE_NAME: Final = "launch.log"

_OUTPUTS: Final[dict[str, dict[str, set[str]]]] = {
    "screen": {"both": {"screen"}},
    "log": {"both": {"log"}, "stderr": {"screen"}},
    "both": {"both": {"log", "screen"}},
    "own_log": {"both": {"own_log"}, "stdout": {"own_log"}, "stderr": {"own_log"}},
    "full": {"both": {"screen", "log", "own_log"}, "stdout": {"own_log"}, "stderr": {"own_log"}},
}


class _Screen(logging.Handler):
    def emit(self, record: logging.LogRecord) -> None:
        if sys.stdout is None:
            return
        try:
            sys.stdout.write(self.format(record) + "\n")
            sys.stdout.flush()
        except BrokenPipeError:
            launch_config.close_screen()
        except (OSError, ValueError):
            pass  # a terminal that is gone: the launch itself goes on


def _formatter(
    variable: str, named: Mapping[str, str], form: str = "default", style: str | None = None
) -> logging.Formatter:
    """The environment variable overrides the form."""
    if form in named and style is not None:
        raise ValueError(f"the format '{form}' has a style of its own, so it can't have the style '{style}'")
    if override := os.environ.get(variable):
        form, style = override, None
    return logging.Formatter(named.get(form, form), style=style or "{")  # type: ignore[arg-type]


class LaunchConfig:
    """How this process logs its launches."""

    def __init__(self) -> None:
        self.level = logging.INFO
        self.on_closed_screen: Callable[[], None] | None = None
        self.is_screen_closed = False
        self._log_dir: Path | None = None
        self._can_write = True
        self._screens: dict[str, logging.Handler] = {}
        self._files: dict[tuple[str, str], logging.Handler] = {}
        self._screen_formatter = _formatter(_SCREEN_VARIABLE, _SCREEN)
        self._file_formatter = _formatter(_FILE_VARIABLE, _FILE)

    def reset(self) -> None:
        """Forget files, formats and the folder."""
        for handler in (*self._files.values(), *self._screens.values()):
            handler.close()
        self.__init__()  # type: ignore[misc]

    def set_screen_format(self, screen_format: str, *, screen_style: str | None = None) -> None:
        """The form of lines on the screen: default, default_with_timestamp, or a template of `logging`.

        `screen_style` is the template's: `{` (the default), `%` or `$`. Raises ValueError for a style of a
        named format.
        """
        self._screen_formatter = _formatter(_SCREEN_VARIABLE, _SCREEN, screen_format, screen_style)
        if "" in self._screens:
            self._screens[""].setFormatter(self._screen_formatter)

    def set_log_format(self, log_format: str, *, log_style: str | None = None) -> None:
        """The form of lines in log files; as `set_screen_format`, but the only named format is default."""
        self._file_formatter = _formatter(_FILE_VARIABLE, _FILE, log_format, log_style)
        for (_, text), handler in self._files.items():
            if not text:
                handler.setFormatter(self._file_formatter)

    @property
    def log_dir(self) -> str:
        """The folder of this launch's log files, made when it is asked for."""
        if self._log_dir is None:
            base = _log_base()
            stamp = datetime.now().strftime("%Y-%m-%d-%H-%M-%S-%f")
            self._log_dir = base / f"{stamp}-{socket.gethostname()}-{os.getpid()}"
            try:
                self._log_dir.mkdir(parents=True, exist_ok=True)
                _link(base / "latest", self._log_dir)
            except OSError:
                self._can_write = False
        return str(self._log_dir)

    @log_dir.setter
    def log_dir(self, new_log_dir: str | None) -> None:
        if new_log_dir is not None and not Path(new_log_dir).is_dir():
            raise ValueError(f"{new_log_dir} is not a directory")
        self._log_dir = None if new_log_dir is None else Path(new_log_dir)

    def get_log_file_path(self, file_name: str = _FILE_NAME) -> str:
        return str(Path(self.log_dir, file_name))

    def get_screen_handler(self, text: str = "") -> logging.Handler:
        if text not in self._screens:
            handler = _Screen()
            handler.setFormatter(logging.Formatter(text, style="{") if text else self._screen_formatter)
            self._screens[text] = handler
        return self._screens[text]

    def get_log_file_handler(self, file_name: str = _FILE_NAME, text: str = "") -> logging.Handler:
        """One handler for each file and form; if a file can't be written, its lines are lost."""
        key = (file_name, text)
        if key not in self._files:
            path = self.get_log_file_path(file_name)
            handler: logging.Handler = logging.NullHandler()
            if self._can_write:
                try:
                    handler = logging.FileHandler(path, encoding="utf-8", errors="backslashreplace")
                except OSError:
                    self._can_write = False
            handler.setFormatter(logging.Formatter(text, style="{") if text else self._file_formatter)
            self._files[key] = handler
        return self._files[key]

    def close_screen(self) -> None:
        """The reader of stdout is gone."""
        self.is_screen_closed = True
        for handler in self._screens.values():
            handler.setLevel(logging.CRITICAL + 1)
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())  # later output goes there
        os.close(nowhere)
        if self.on_closed_screen is not None:
            self.on_closed_screen()


launch_config: Final = LaunchConfig()
_ours: Final[dict[str, logging.Logger]] = {}


def reset() -> None:
    """Forget loggers, files and the folder; the next launch has its own."""
    _ours.clear()
    launch_config.reset()


def log_launch_config(*, logger: logging.Logger) -> None:
    """Log the folder of the log files, and the level of logging."""
    folder = launch_config.log_dir
    if launch_config._can_write:
        logger.info(f"All log files can be found below {folder}")
    else:
        logger.warning(f"There are no log files: {folder} can't be written")
    logger.info(f"Default logging verbosity is set to {logging.getLevelName(launch_config.level)}")


def get_logger(name: str | None = None) -> logging.Logger:
    """A logger for the screen and the launch's log file."""
    name = name or "launch"
    if name not in _ours:
        handlers = [launch_config.get_screen_handler(), launch_config.get_log_file_handler()]
        _ours[name] = _make(name, handlers)
    _ours[name].setLevel(launch_config.level)
    return _ours[name]


def get_output_loggers(
    process_name: str, output_config: str | Mapping[str, Any]
) -> tuple[logging.Logger, logging.Logger]:
    """Loggers for the lines of a process: one for its stdout, one for its stderr.

    `output_config`: screen, log, both, own_log or full, or a dict of stdout, stderr and both, each of which
    has some of screen, log and own_log. Raises ValueError for other words.
    """
    outputs = _normalized(output_config)
    stdout, stderr = (
        _make(f"{process_name}-{source}", _line_handlers(process_name, source, outputs))
        for source in ("stdout", "stderr")
    )
    return stdout, stderr


def _make(name: str, handlers: list[logging.Handler]) -> logging.Logger:
    logger = logging.Logger(name)  # noqa: LOG001 (ours alone: no handler of the program's root hears it)
    logger.setLevel(logging.INFO)
    for handler in handlers:
        logger.addHandler(handler)
    return logger


def _line_handlers(process_name: str, source: str, outputs: Mapping[str, set[str]]) -> list[logging.Handler]:
    places = outputs.get("both", set()) | outputs.get(source, set())
    found: list[logging.Handler] = []
    if "screen" in places:
        found.append(launch_config.get_screen_handler(_LINE))
    if "log" in places:
        found.append(launch_config.get_log_file_handler(_FILE_NAME, _LINE_IN_FILE))
    if "own_log" in outputs.get("both", set()):
        found.append(launch_config.get_log_file_handler(f"{process_name}.log", _LINE))
    if "own_log" in outputs.get(source, set()):
        found.append(launch_config.get_log_file_handler(f"{process_name}-{source}.log", _LINE))
    return found


def _normalized(config: str | Mapping[str, Any]) -> Mapping[str, set[str]]:
    if isinstance(config, str):
        if config not in _OUTPUTS:
            raise ValueError(f'{config} is not a valid standard output config i.e. "screen", "log" or "both"')
        return _OUTPUTS[config]
    found: dict[str, set[str]] = {}
    for source, places in config.items():
        if source not in ("stdout", "stderr", "both"):
            raise ValueError(f'{source} is not a valid output source i.e. "stdout", "stderr" or "both"')
        found[source] = {places} if isinstance(places, str) else set(places)
        for place in found[source] - {"screen", "log", "own_log"}:
            raise ValueError(f'{place} is not a valid output destination i.e. "screen", "log" or "own_log"')
    return found


def _log_base() -> Path:
    folder = os.environ.get("ROS_LOG_DIR")
    if folder:
        return Path(folder).expanduser()
    return Path(os.environ.get("ROS_HOME") or "~/.ros").expanduser() / "log"


def _link(link: Path, target: Path) -> None:
    """`latest` leads to the newest folder; if it is no link, it stays."""
    new = link.with_name(f".latest-{os.getpid()}")
    if link.exists() and not link.is_symlink():
        return
    new.symlink_to(target, target_is_directory=True)
    new.replace(link)
