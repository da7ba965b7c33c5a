"""Parameter files of a node that a launch starts: named files, and files made of dicts."""

import os
import tempfile
from collections.abc import Iterable
from pathlib import Path
from typing import Any

from bus_launch.launch import logging
from bus_launch.launch.core import LaunchContext, perform_substitutions
from bus_launch.launch.frontend.parser import Parser
from bus_launch.launch.yaml_values import dump
from bus_launch.launch_ros.parameter_descriptions import ParameterFile
from bus_launch.launch_ros.parameter_values import evaluated

__all__ = ["FileArguments", "text_of"]


class FileArguments:
    """Made for one process; `remove` when that has ended."""

    def __init__(self) -> None:
        self._made: list[str] = []

    def make(self, context: LaunchContext, parameters: Iterable[Any], pattern: str) -> list[str]:
        """The arguments for files and dicts. Later ones come last, because they take precedence.

        `pattern`: the nodes that dicts are for. Raises TypeError for a value that no parameter can have,
        OSError for a file that can't be made.
        """
        words: list[str] = []
        for one in parameters:
            if isinstance(one, ParameterFile):
                path = self._file(context, one)
                words += [] if path is None else ["--params-file", path]
                continue
            values = evaluated(context, one)
            if values:
                text = dump({pattern: {"ros__parameters": values}})
                words += ["--params-file", self._write(text)]
        return words

    def remove(self) -> None:
        for path in self._made:
            try:
                os.unlink(path)  # noqa: PTH108
            except OSError:
                pass
        self._made.clear()

    def _file(self, context: LaunchContext, file: ParameterFile) -> str | None:
        if not file.may_have_substitutions(context):
            path = _present(context, file)
            return None if path is None else str(path)
        text = text_of(context, file)
        return None if text is None else self._write(text)

    def _write(self, text: str) -> str:
        fd, path = tempfile.mkstemp(prefix="launch_params_")
        self._made.append(path)
        with os.fdopen(fd, "w", encoding="utf-8") as file:
            file.write(text)
        return path


def text_of(context: LaunchContext, file: ParameterFile) -> str | None:
    """The text of a file, with its substitutions performed. None and a warning if there is no file.

    Raises OSError or UnicodeDecodeError for a file that can't be read.
    """
    path = _present(context, file)
    if path is None:
        return None
    text = path.read_text("utf-8")
    if not file.may_have_substitutions(context):
        return text
    return perform_substitutions(context, Parser().parse_substitution(text))


def _present(context: LaunchContext, file: ParameterFile) -> Path | None:
    path = file.evaluate(context)
    if path.is_file():
        return path
    logging.get_logger("launch_ros").warning(f"Parameter file path is not a file: {path}")
    return None  # as in ROS 2, the program starts without it
