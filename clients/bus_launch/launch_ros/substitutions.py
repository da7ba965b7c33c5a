"""Substitutions for packages and parameters; programs import it as `launch_ros.substitutions`."""

from collections.abc import Sequence
from typing import Any

from bus_launch.launch.core import (
    LaunchContext,
    SomeSubstitutionsType,
    Substitution,
    SubstitutionFailure,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.frontend import expose_substitution
from bus_launch.launch.substitutions import PathJoinSubstitution
from bus_launch.launch.substitutions.values import arguments_of, described
from bus_launch.launch_ros import programs
from bus_launch.launch_ros.parameter_values import evaluated

__all__ = [
    "ExecutableInPackage",
    "FindPackage",
    "FindPackagePrefix",
    "FindPackageShare",
    "Parameter",
]

__path__: list[str] = []  # there may be modules in it: a file for each class, as in ROS 2

_Parsed = tuple[type[Substitution], dict[str, Any]]


class FindPackage(Substitution):
    """A folder of a package; `package / part` makes a path in it."""

    def __init__(self, package: SomeSubstitutionsType) -> None:
        super().__init__()
        self.__package = normalize_to_list_of_substitutions(package)

    @property
    def package(self) -> list[Substitution]:
        return self.__package

    def describe(self) -> str:
        return f"{type(self).__name__}(pkg={described(self.__package)})"

    def find(self, package_name: str) -> str:
        raise NotImplementedError

    def perform(self, context: LaunchContext) -> str:
        return self.find(perform_substitutions(context, self.__package))

    def __truediv__(self, additional_path: SomeSubstitutionsType) -> PathJoinSubstitution:
        return PathJoinSubstitution([self, additional_path])


@expose_substitution("find-pkg-prefix")
class FindPackagePrefix(FindPackage):
    """The folder that a package is installed under."""

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        return cls, {"package": arguments_of("find-pkg-prefix", data, 1)[0]}

    def find(self, package_name: str) -> str:
        return programs.package_prefix(package_name)


@expose_substitution("find-pkg-share")
class FindPackageShare(FindPackage):
    """The folder with a package's files, such as launch files."""

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        return cls, {"package": arguments_of("find-pkg-share", data, 1)[0]}

    def find(self, package_name: str) -> str:
        return programs.find_share(package_name)


@expose_substitution("exec-in-pkg")
class ExecutableInPackage(Substitution):
    """The path of a package's program."""

    def __init__(self, executable: SomeSubstitutionsType, package: SomeSubstitutionsType) -> None:
        super().__init__()
        self.__executable = normalize_to_list_of_substitutions(executable)
        self.__package = normalize_to_list_of_substitutions(package)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        executable, package = arguments_of("exec-in-pkg", data, 2)
        return cls, {"executable": executable, "package": package}

    def describe(self) -> str:
        return f"ExecInPkg(pkg={described(self.__package)}, exec={described(self.__executable)})"

    def perform(self, context: LaunchContext) -> str:
        package = perform_substitutions(context, self.__package)
        return programs.find(package, perform_substitutions(context, self.__executable)).path


@expose_substitution("param")
class Parameter(Substitution):
    """A parameter that SetParameter has set for all nodes."""

    def __init__(self, name: SomeSubstitutionsType, *, default: SomeSubstitutionsType | None = None) -> None:
        super().__init__()
        self.__name = normalize_to_list_of_substitutions(name)
        self.__default = None if default is None else normalize_to_list_of_substitutions(default)

    @classmethod
    def parse(cls, data: Sequence[Any]) -> _Parsed:
        arguments_of("param", data, 1, 2)
        return cls, dict(zip(("name", "default"), data, strict=False))

    def describe(self) -> str:
        return f"Parameter({described(self.__name)})"

    def perform(self, context: LaunchContext) -> str:
        name = perform_substitutions(context, self.__name)
        for one in reversed(context.launch_configurations.get("global_params", [])):
            if isinstance(one, list) and name in (values := evaluated(context, one)):
                return str(values[name])
        if self.__default is None:
            raise SubstitutionFailure(f"parameter '{name}' not found")
        return perform_substitutions(context, self.__default)
