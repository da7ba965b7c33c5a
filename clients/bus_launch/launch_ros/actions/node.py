"""The action that runs a node; programs import it from `launch_ros.actions`."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from bus.names import validate_namespace, validate_node_name
from bus_launch.launch.action import Action
from bus_launch.launch.actions import ExecuteLocal, ExecuteProcess
from bus_launch.launch.core import (
    LaunchContext,
    LaunchDescriptionEntity,
    SomeSubstitutionsType,
    Substitution,
    normalize_to_list_of_substitutions,
    perform_substitutions,
)
from bus_launch.launch.descriptions import Executable
from bus_launch.launch.frontend import Entity, Parser, expose_action
from bus_launch.launch_ros import programs
from bus_launch.launch_ros.namespaces import make_namespace_absolute, prefix_namespace
from bus_launch.launch_ros.parameter_files import FileArguments
from bus_launch.launch_ros.remap_rules import normalize_remap_rules
from bus_launch.launch_ros.tags import parse_parameters, parse_remaps
from bus_launch.launch_ros.utilities import normalize_parameters

__all__ = ["Node"]


class _NodeProgram(Executable):
    """The program of a node. Its words begin with its path, but what is executed may be Python with it."""

    def __init__(
        self,
        *,
        package: list[Substitution] | None,
        executable: list[Substitution],
        ros_arguments: "Iterable[SomeSubstitutionsType]",
        **kwargs: Any,
    ) -> None:
        super().__init__(cmd=[executable], **kwargs)
        self._package = package
        self._executable = executable
        self._ros_arguments = [normalize_to_list_of_substitutions(one) for one in ros_arguments]
        self._start: list[str] = []
        self._rules: list[str] = []

    def set_rules(self, rules: Sequence[str]) -> None:
        """The arguments behind --ros-args, except the arguments that the file gives itself."""
        self._rules = list(rules)

    def prepare(self, context: LaunchContext, action: Action) -> None:
        name = perform_substitutions(context, self._executable)
        package = None if self._package is None else perform_substitutions(context, self._package)
        program = programs.outside(name) if package is None else programs.find(package, name)
        super().prepare(context, action)
        assert self._final_cmd is not None
        arguments = self._final_cmd[len(self._final_prefix) + 1 :]
        given = [perform_substitutions(context, one) for one in self._ros_arguments]
        words = [*arguments, "--ros-args", *given, *self._rules]
        self._start = [*self._final_prefix, *program.start, *words]
        self._final_cmd = [*self._final_prefix, program.path, *words]

    def command(self) -> list[str]:
        return self._start


@expose_action("node")
class Node(ExecuteProcess):
    """Runs a program of a package as a node, with a name, a namespace, parameters and remappings."""

    def __init__(  # noqa: PLR0913 (the genuine one's)
        self,
        *,
        executable: SomeSubstitutionsType,
        package: SomeSubstitutionsType | None = None,
        name: SomeSubstitutionsType | None = None,
        namespace: SomeSubstitutionsType | None = None,
        exec_name: SomeSubstitutionsType | None = None,
        parameters: Iterable[Any] | None = None,
        remappings: Iterable[tuple[SomeSubstitutionsType, SomeSubstitutionsType]] | None = None,
        ros_arguments: Iterable[SomeSubstitutionsType] | None = None,
        arguments: Iterable[SomeSubstitutionsType] | None = None,
        prefix: SomeSubstitutionsType | None = None,
        cwd: SomeSubstitutionsType | None = None,
        env: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None = None,
        additional_env: Mapping[SomeSubstitutionsType, SomeSubstitutionsType] | None = None,
        **kwargs: Any,
    ) -> None:
        """`exec_name`: of the process. `parameters`: paths of files, and dicts. `arguments`: of the program.

        Other arguments are those of ExecuteProcess.
        """
        if isinstance(arguments, str) or isinstance(ros_arguments, str):
            raise TypeError("arguments and ros_arguments are lists of words, not one text")
        self.__package = None if package is None else normalize_to_list_of_substitutions(package)
        self.__executable = normalize_to_list_of_substitutions(executable)
        self.__name = None if name is None else normalize_to_list_of_substitutions(name)
        self.__namespace = None if namespace is None else normalize_to_list_of_substitutions(namespace)
        self.__parameters = normalize_parameters(parameters or ())
        self.__remappings = list(normalize_remap_rules(remappings or ()))
        self.__program = _NodeProgram(
            package=self.__package,
            executable=self.__executable,
            ros_arguments=ros_arguments or (),
            arguments=arguments,
            prefix=prefix,
            name=exec_name,
            cwd=cwd,
            env=env,
            additional_env=additional_env,
        )
        self.__full_name: str | None = None
        self.__files = FileArguments()
        ExecuteLocal.__init__(self, process_description=self.__program, **kwargs)

    @classmethod
    def parse(
        cls, entity: Entity, parser: Parser, ignore: Iterable[str] = ()
    ) -> tuple[type[Action], dict[str, Any]]:
        _, kwargs = super().parse(entity, parser, ignore=["cmd", "name"])
        words = entity.get_attr("args", optional=True)
        if words is not None:
            kwargs["arguments"] = cls._parse_cmdline(words, parser)
        words = entity.get_attr("ros_args", optional=True)
        if words is not None:
            kwargs["ros_arguments"] = cls._parse_cmdline(words, parser)
        kwargs["executable"] = parser.parse_substitution(entity.get_attr("exec"))
        for attribute, argument in (
            ("pkg", "package"),
            ("name", "name"),
            ("namespace", "namespace"),
            ("exec_name", "exec_name"),
        ):
            value = entity.get_attr(attribute, optional=True)
            if value is not None:
                kwargs[argument] = parser.parse_substitution(value)
        remaps = parse_remaps(entity, parser)
        if remaps is not None:
            kwargs["remappings"] = remaps
        parameters = parse_parameters(entity, parser)
        if parameters is not None:
            kwargs["parameters"] = parameters
        return cls, kwargs

    @property
    def node_package(self) -> list[Substitution] | None:
        return self.__package

    @property
    def node_executable(self) -> list[Substitution]:
        return self.__executable

    @property
    def node_name(self) -> str:
        """The full name; raises RuntimeError before the action is executed."""
        if self.__full_name is None:
            raise RuntimeError("cannot access 'node_name' before executing action")
        return self.__full_name

    @property
    def expanded_node_name(self) -> str:
        return self.node_name.rpartition("/")[2]

    @property
    def expanded_node_namespace(self) -> str:
        return self.node_name.rpartition("/")[0] or "/"

    def is_node_name_fully_specified(self) -> bool:
        return self.__name is not None

    def prepare(self, context: LaunchContext) -> None:
        name, namespace = self.__expanded(context)
        has_name = name is not None
        self.__full_name = f"{(namespace or '/').rstrip('/')}/{name or '<node_name_unspecified>'}"
        rules: list[str] = []
        if has_name:
            rules += ["-r", f"__node:={name}"]
        if namespace is not None:
            rules += ["-r", f"__ns:={namespace}"]
        configurations = context.launch_configurations
        shared = configurations.get("global_params", [])
        pattern = self.__full_name if has_name else "/**"
        rules += self.__files.make(context, [*shared, *self.__parameters], pattern)
        for old, new in [*configurations.get("ros_remaps", []), *self.__remappings]:
            rules += ["-r", f"{perform_substitutions(context, old)}:={perform_substitutions(context, new)}"]
        self.__program.set_rules(rules)
        super().prepare(context)

    def __expanded(self, context: LaunchContext) -> tuple[str | None, str | None]:
        """Name and absolute namespace, if they are given; raises ConfigurationError for bad ones."""
        name = None if self.__name is None else perform_substitutions(context, self.__name)
        if name is not None:
            validate_node_name(name)
        base = context.launch_configurations.get("ros_namespace")
        own = None if self.__namespace is None else perform_substitutions(context, self.__namespace)
        if own is None and base is None:
            return name, None
        namespace = make_namespace_absolute(prefix_namespace(base, own))
        validate_namespace(namespace)
        return name, namespace

    def execute(self, context: LaunchContext) -> Sequence[LaunchDescriptionEntity] | None:
        try:
            super().execute(context)
        except BaseException:
            self.__files.remove()
            raise
        future = self.get_asyncio_future()
        if future is None:
            self.__files.remove()
        else:
            future.add_done_callback(lambda _: self.__files.remove())
        return None
