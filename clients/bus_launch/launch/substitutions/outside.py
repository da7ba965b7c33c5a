"""Substitutions for things outside the launch: environment, files, programs, Python expressions."""

import shlex
import shutil
import subprocess
from collections.abc import Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from bus_launch.launch import logging
from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend import expose_substitution
from bus_launch.launch.substitutions.values import arguments_of, described

__all__ = ["Command", "EnvironmentVariable", "FileContent", "FindExecutable", "PythonExpression"]

_Parsed = tuple[type[Substitution], dict[str, Any]]


@expose_substitution("env")
@expose_substitution("optenv")
class EnvironmentVariable(Substitution):
    """The value of an environment variable, or the default; SubstitutionFailure if there is neither."""

    def __init__(
        self, name: SomeSubstitutionsType, *, default_value: SomeSubstitutionsType | None = None
    ) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)
        self.__default = None if default_value is None else normalize_to_list_of_substitutions(default_value)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("env", data, 1, 2)
        return cls, dict(zip(("name", "default_value"), data, strict=False))

    @property
    def name(self) -> list[Substitution]:
        return self.__name

    @property
    def default_value(self) -> list[Substitution] | None:
        return self.__default

    def describe(self) -> str:
        return f"EnvVar({described(self.__name)})"

    def perform(self, context: LaunchContext) -> str:
        name = perform_substitutions(context, self.__name)
        if name in context.environment:
            return context.environment[name]
        if self.__default is None:
            raise SubstitutionFailure(f"environment variable '{name}' does not exist")
        return perform_substitutions(context, self.__default)


@expose_substitution("file-content")
class FileContent(Substitution):
    """The content of a file."""

    def __init__(self, path: SomeSubstitutionsType) -> None:
        super().__init__()
        self.__path = normalize_to_list_of_substitutions(path)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        return cls, {"path": arguments_of("file-content", data, 1)[0]}

    @property
    def path(self) -> list[Substitution]:
        return self.__path

    def describe(self) -> str:
        return f"FileContent({described(self.__path)})"

    def perform(self, context: LaunchContext) -> str:
        path = perform_substitutions(context, self.__path)
        try:
            return Path(path).read_text("utf-8")
        except FileNotFoundError:
            raise SubstitutionFailure(f"File not found: {path}") from None
        except (OSError, UnicodeDecodeError) as error:
            raise SubstitutionFailure(f"Failed to open file '{path}': {error}") from None


@expose_substitution("find-exec")
class FindExecutable(Substitution):
    """The path of a program found in PATH."""

    def __init__(self, name: SomeSubstitutionsType) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        return cls, {"name": arguments_of("find-exec", data, 1)[0]}

    @property
    def name(self) -> list[Substitution]:
        return self.__name

    def describe(self) -> str:
        return f"FindExec({described(self.__name)})"

    def perform(self, context: LaunchContext) -> str:
        name = perform_substitutions(context, self.__name)
        path = shutil.which(name, path=context.environment.get("PATH"))
        if path is None:
            raise SubstitutionFailure(f"executable '{name}' not found on the PATH")
        return path


@expose_substitution("command")
class Command(Substitution):
    """The output of a program. `on_stderr`: fail, warn, ignore or capture its output on stderr."""

    def __init__(self, command: SomeSubstitutionsType, *, on_stderr: SomeSubstitutionsType = "fail") -> None:
        super().__init__()
        self.__command = normalize_to_list_of_substitutions(command)
        self.__on_stderr = normalize_to_list_of_substitutions(on_stderr)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("command", data, 1, 2)
        return cls, dict(zip(("command", "on_stderr"), data, strict=False))

    @property
    def command(self) -> list[Substitution]:
        return self.__command

    @property
    def on_stderr(self) -> list[Substitution]:
        return self.__on_stderr

    def describe(self) -> str:
        return f"Command({described(self.__command)})"

    def perform(self, context: LaunchContext) -> str:
        text = perform_substitutions(context, self.__command)
        on_stderr = perform_substitutions(context, self.__on_stderr)
        if on_stderr not in ("fail", "ignore", "warn", "capture"):
            raise SubstitutionFailure(
                f"expected 'on_stderr' to be one of: 'fail', 'ignore', 'warn' or 'capture', got '{on_stderr}'"
            )
        errors = subprocess.STDOUT if on_stderr == "capture" else subprocess.PIPE
        try:
            words = shlex.split(text)
            done = subprocess.run(
                words, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, check=False
            )
        except (OSError, ValueError, IndexError) as error:
            reason = f"file not found: {error}" if isinstance(error, FileNotFoundError) else error
            raise SubstitutionFailure(str(reason)) from None
        said = (done.stderr or b"").decode(errors="replace")
        output = done.stdout.decode(errors="replace")
        if done.returncode != 0:
            text = f"executed command failed. Command: {text}"
            if said:
                text += f"\nCaptured stderr output: {said}"
            raise SubstitutionFailure(text)
        if said and on_stderr in ("fail", "warn"):
            problem = (
                f"executed command showed stderr output. Command: {text}\nCaptured stderr output:\n{said}"
            )
            if on_stderr == "fail":
                raise SubstitutionFailure(problem)
            logging.get_logger("launch").warning(problem)
        return output


@expose_substitution("eval")
class PythonExpression(Substitution):
    """The value of a Python expression, as text. It sees `python_modules`, and the names in `math`."""

    def __init__(
        self, expression: SomeSubstitutionsType, python_modules: SomeSubstitutionsType = ("math",)
    ) -> None:
        super().__init__()
        self.__expression = normalize_to_list_of_substitutions(expression)
        self.__modules = normalize_to_list_of_substitutions(python_modules)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("eval", data, 1, 2)
        arguments: dict[str, Any] = {"expression": data[0]}
        if len(data) == 2:
            arguments["python_modules"] = [
                name.strip() for part in data[1] for name in part.perform(None).split(",")
            ]
        return cls, arguments

    @property
    def expression(self) -> list[Substitution]:
        return self.__expression

    @property
    def python_modules(self) -> list[Substitution]:
        return self.__modules

    def describe(self) -> str:
        modules = ", ".join(one.describe() for one in self.__modules)
        return f"PythonExpr({described(self.__expression)}, [{modules}])"

    def perform(self, context: LaunchContext) -> str:
        text = perform_substitutions(context, self.__expression)
        names: dict[str, Any] = {}
        for name in filter(None, (context.perform_substitution(one) for one in self.__modules)):
            module = import_module(name)
            if name == "math":
                names.update(vars(module))
            names[name] = module
        try:
            return str(eval(text, names))
        except Exception as error:
            # Programs may catch a NameError: an expression with a module that was not given.
            kind = NameError if isinstance(error, NameError) else SubstitutionFailure
            raise kind(f"the expression '{text}' failed: {type(error).__name__}: {error}") from None
