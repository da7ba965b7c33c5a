"""Parameter files of a node that a launch starts: named files, and files made of dicts."""

import os
import tempfile
from collections.abc import Iterable
from typing import Any

from bus_launch.launch import logging
from bus_launch.launch.core import LaunchContext, perform_substitutions
from bus_launch.launch.frontend.parser import Parser
from bus_launch.launch.yaml_values import dump
from bus_launch.launch_ros.descriptions import ParameterFile
from bus_launch.launch_ros.parameter_values import evaluated

__all__ = ["FileArguments"]


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
        path = file.evaluate(context)
        if not path.is_file():
            logging.get_logger("launch_ros").warning(f"Parameter file path is not a file: {path}")
            return None  # as in ROS 2, the program starts without it
        if not file.may_have_substitutions(context):
            return str(path)
        text = path.read_text("utf-8")
        return self._write(perform_substitutions(context, Parser().parse_substitution(text)))

    def _write(self, text: str) -> str:
        fd, path = tempfile.mkstemp(prefix="launch_params_")
        self._made.append(path)
        with os.fdopen(fd, "w", encoding="utf-8") as file:
            file.write(text)
        return path
