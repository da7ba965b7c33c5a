"""Makes `import rclpy` and `from std_msgs.msg import String` work without ROS 2; importing it is enough.

Owns: ROS 2's names and the modules that they lead to, and the behaviour of modules of message classes. Must
not know: the content of these modules. They are imported only when a program asks for them.

It fills in only modules that can't be imported: a machine with ROS 2 works as before. `install(force=True)`
(or BUS_RCLPY_FORCE=1 in the environment) puts busd's modules in front of installed ones.

    rclpy, rclpy.*; launch, tf2_ros, ...     the same modules as bus_ros.rclpy, bus_ros.rclpy.*; see _SAME
    <pkg>.msg, .srv, .action                 classes made of the definitions that bus.types.definitions finds
    <pkg>                                    an empty package, if there is no real one
    rosidl_runtime_py, rosidl_parser
"""

import os
import sys
from collections.abc import Sequence
from functools import partial
from importlib import import_module
from importlib.machinery import ModuleSpec, PathFinder
from types import CodeType, FrameType, ModuleType
from typing import Any, Final, NoReturn

from bus import _import as import_at_once
from bus_ros.filled import Filled, spec_of

__all__ = ["install"]

_KINDS: Final = ("msg", "srv", "action")

_SAME: Final = {
    "ament_index_python": "bus_ros.ament_index_python",
    "cv_bridge": "bus_ros.cv_bridge",
    "diagnostic_updater": "bus_ros.diagnostic_updater",
    "image_geometry": "bus_ros.image_geometry",
    "interactive_markers": "bus_ros.interactive_markers",
    "laser_geometry": "bus_ros.laser_geometry",
    "launch": "bus_launch.launch",
    "launch_pytest": "bus_launch.launch_pytest",
    "launch_ros": "bus_launch.launch_ros",
    "launch_testing": "bus_launch.launch_testing",
    "launch_testing_ros": "bus_launch.launch_testing_ros",
    "launch_xml": "bus_launch.launch_xml",
    "launch_yaml": "bus_launch.launch_yaml",
    "message_filters": "bus_ros.message_filters",
    "nav2_common": "bus_launch.nav2_common",
    "rclpy": "bus_ros.rclpy",
    "ros2action": "bus_ros.ros2action",
    "ros2cli": "bus_ros.ros2cli",
    "ros2interface": "bus_ros.ros2interface",
    "ros2lifecycle": "bus_ros.ros2lifecycle",
    "ros2node": "bus_ros.ros2node",
    "ros2param": "bus_ros.ros2param",
    "ros2pkg": "bus_ros.ros2pkg",
    "ros2run": "bus_ros.ros2run",
    "ros2service": "bus_ros.ros2service",
    "ros2topic": "bus_ros.ros2topic",
    "rosbag2_py": "bus_bag.rosbag2_py",
    "rosidl_adapter": "bus_ros.rosidl_adapter",
    "sensor_msgs_py": "bus_ros.sensor_msgs_py",
    "tf2_geometry_msgs": "bus_tf2.tf2_geometry_msgs",
    "tf2_py": "bus_tf2.tf2_py",
    "tf2_ros": "bus_tf2.tf2_ros",
    "tf2_sensor_msgs": "bus_tf2.tf2_sensor_msgs",
    "tf_transformations": "bus_tf2.tf_transformations",
    "turtle_tf2_py": "bus_tf2.turtle_tf2_py",
}
"""Packages with exactly the modules of one of busd's packages."""

_PARTS_OF: Final = {
    **dict.fromkeys(
        (
            *("launch_pytest", "launch_ros", "launch_testing", "launch_testing_ros", "launch_xml"),
            *("launch_yaml", "nav2_common"),
        ),
        "launch",
    ),
    **dict.fromkeys(
        (
            *("ros2action", "ros2cli", "ros2lifecycle", "ros2node", "ros2param", "ros2service"),
            "ros2topic",
        ),
        "rclpy",
    ),
}
"""Packages of busd that only work with another package of busd: a genuine one does not know them."""

_ALIASES: Final = {
    **dict.fromkeys(
        (
            *("launch.condition", "launch.event", "launch.event_handler", "launch.launch_context"),
            *("launch.launch_description_entity", "launch.some_actions_type"),
            *("launch.some_entities_type", "launch.some_substitutions_type", "launch.substitution"),
        ),
        "bus_launch.launch.core",
    ),
    "launch.actions.shutdown_action": "bus_launch.launch.actions",
    "launch.frontend.parse_substitution": "bus_launch.launch.frontend.grammar",
    "launch.utilities.class_tools_impl": "bus_launch.launch.core",
    "launch.invalid_launch_file_error": "bus_launch.launch.errors",
    "launch.launch_description_source": "bus_launch.launch.launch_description_sources",
    "launch_ros.remap_rule_type": "bus_launch.launch_ros.parameters_type",
    "launch_testing.event_handlers.stdout_ready_listener": "bus_launch.launch_testing.event_handlers",
    "launch_testing.io_handler": "bus_launch.launch_testing.processes",
    "launch_testing.parametrize": "bus_launch.launch_testing",
    "launch_testing.proc_info_handler": "bus_launch.launch_testing.processes",
    "launch_testing.ready_aggregator": "bus_launch.launch_testing.ready",
    "launch_testing.ready_to_test_action_timeout": "bus_launch.launch_testing.ready",
    "launch_testing.tools.text": "bus_launch.launch_testing.text",
    "launch_testing.util.proc_lookup": "bus_launch.launch_testing.lookup",
    **{
        f"launch_testing.asserts.assert_{name}": "bus_launch.launch_testing.asserts"
        for name in ("exit_codes", "output", "sequential_output")
    },
    **{
        f"launch_testing.actions.{name}": "bus_launch.launch_testing.actions"
        for name in ("gtest", "pytest", "ready", "test")
    },
    "launch_xml.launch_description_sources": "bus_launch.launch.launch_description_sources",
    "launch_yaml.launch_description_sources": "bus_launch.launch.launch_description_sources",
    "rosidl_parser.definition": "bus_ros.rosidl.definition",
    "rosidl_runtime_py.convert": "bus_ros.rosidl.runtime",
    "rosidl_runtime_py.get_interfaces": "bus_ros.rosidl.interfaces",
    "rosidl_runtime_py.import_message": "bus_ros.rosidl.utilities",
    "rosidl_runtime_py.set_message": "bus_ros.rosidl.runtime",
    "rosidl_runtime_py.utilities": "bus_ros.rosidl.utilities",
    "tf2_tools.view_frames": "bus_tf2.programs.view_frames",
}
_WITH_CLASS_FILES: Final = frozenset(
    (
        *("launch.actions", "launch.conditions", "launch.descriptions", "launch.event_handlers"),
        *("launch.events", "launch.events.process"),
        *("launch.launch_description_sources", "launch.substitutions", "launch_ros.actions"),
        *("launch_ros.descriptions", "launch_ros.event_handlers", "launch_ros.substitutions"),
    )
)
"""Packages with a file for each class in ROS 2: LogInfo is also in `launch.actions.log_info`."""

_PACKAGES: Final[dict[str, tuple[str, ...]]] = {
    "rosidl_parser": (),
    "rosidl_runtime_py": ("bus_ros.rosidl.interfaces", "bus_ros.rosidl.runtime", "bus_ros.rosidl.utilities"),
    "tf2_tools": (),
}
"""Packages, each with the modules that have its names."""

_MISSING: Final = frozenset(
    (
        *("ament_package", "domain_coordinator"),
        *("nav2_simple_commander", "ros2bag", "ros2component", "ros2doctor", "ros2launch"),
        *("rosidl_generator_py", "rpyutils", "rqt_gui", "rqt_gui_py", "sros2", "tf2_kdl"),
    )
)
"""Packages of ROS 2 that busd does not have."""

_ENVIRONMENT: Final = {"ROS_VERSION": "2", "ROS_PYTHON_VERSION": "3", "ROS_DISTRO": "jazzy"}
"""Variables that ROS 2's set-up sets. Some programs read them before they import rclpy."""


def install(*, force: bool = False) -> None:
    """Put the finders into Python's import system; may be called again, also with another `force`.

    `force`: busd's modules come before installed ones. Modules that are imported already stay as they are.
    If `import rclpy` gives busd's, the environment gets the variables of ROS 2's set-up that it lacks.
    """
    _last.is_forced = _first.is_forced = force
    for finder in (_first, _last):
        if finder in sys.meta_path:
            sys.meta_path.remove(finder)
    sys.meta_path.insert(0, _first)
    sys.meta_path.append(_last)
    if _leads_to_ours("rclpy"):
        for name, value in _ENVIRONMENT.items():
            os.environ.setdefault(name, value)


class _First:
    """The finder before all others: for all of busd's modules if forced, else for modules hidden by folders.

    A folder of definitions, or one with launch files, is an empty package for Python.
    """

    is_forced = False

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        root, _, rest = name.partition(".")
        if self.is_forced:
            is_ours = root in _SAME or root in _PACKAGES or rest.partition(".")[0] in _KINDS
            return _spec(name) if is_ours else None
        if rest and _is_same(root):
            return _spec(name)  # otherwise its __path__ would make others load the same file again
        if root == "bus" or (rest not in _KINDS if rest else root not in _SAME and root not in _PACKAGES):
            return None
        return _spec(name) if _is_folder(PathFinder.find_spec(name, path)) else None


class _Last:
    """The finder after all others, for modules that no other finder has."""

    is_forced = False

    def find_spec(
        self, name: str, path: Sequence[str] | None = None, target: ModuleType | None = None
    ) -> ModuleSpec | None:
        found = _spec(name)
        if found is None:
            _refuse(name)
        return found


_first: Final = _First()
_last: Final = _Last()


def _spec(name: str) -> ModuleSpec | None:
    root, _, rest = name.partition(".")
    if root == "bus" or root in sys.stdlib_module_names:  # such as msvcrt, which `subprocess` tries to import
        return None
    if root in _SAME:
        if rest and not _is_same(root):
            return None  # a part that the real package does not have
        if root in _PARTS_OF and not _leads_to_ours(_PARTS_OF[root]):
            return None
        return _alias(name, _ALIASES.get(name) or _SAME[root] + name.removeprefix(root)) or _class_file(name)
    if name in _ALIASES:
        return _alias(name, _ALIASES[name]) if _is_ours(root) else None
    if name in _PACKAGES:
        return spec_of(name, Filled(partial(_fill_package, _PACKAGES[name])), is_package=True)
    kind, _, part = rest.partition(".")
    if rest and (kind not in _KINDS or "." in part):
        return None

    from bus.types import definitions

    if not hasattr(definitions, "names"):
        return None  # it is being imported, and its imports include a missing module
    if not rest:
        is_known = root.isidentifier() and definitions.names(None, root)
        return spec_of(name, Filled(_fill_empty), is_package=True) if is_known else None
    known = [full.rpartition("/")[2] for full in definitions.names(kind, root)]  # type: ignore[arg-type]
    if part:
        from bus_ros.rosidl.classes import module_of

        if not _is_ours(f"{root}.{kind}"):
            return None
        known = [short for short in known if module_of(f"{root}/{kind}/{short}") == name]
    if not known:
        return None
    return spec_of(name, Filled(partial(_fill_types, root, kind, known)), is_package=not part)


def _is_same(root: str) -> bool:
    """Whether the package of that name is busd's, and imported."""
    return root in _SAME and root in sys.modules and sys.modules[root] is sys.modules.get(_SAME[root])


def _leads_to_ours(root: str) -> bool:
    """Whether importing a package gives busd's."""
    if root in sys.modules:
        return _is_same(root)
    found = PathFinder.find_spec(root)
    return _first.is_forced or found is None or _is_folder(found)


def _is_folder(found: ModuleSpec | None) -> bool:
    """Whether a package is a plain folder without a file that belongs to it."""
    return found is not None and found.origin is None


def _is_ours(name: str) -> bool:
    return isinstance(getattr(sys.modules.get(name), "__loader__", None), Filled)


def _refuse(name: str) -> None:
    """Raise an error that says why a part of ROS 2 is missing; return if `name` is not such a part."""
    root, _, rest = name.partition(".")
    if root in _SAME:
        if not rest or not _is_same(root):
            return
        text = f"busd has no '{name}', and perhaps {root} has none in ROS 2 either"
    elif rest:
        return
    elif root in _MISSING:
        text = f"busd has no '{name}', which is a part of ROS 2"
    elif root.endswith(("_msgs", "_interfaces")):
        text = (
            f"busd has no '{name}': there are no definitions of that package in the workspace, in "
            "AMENT_PREFIX_PATH or in BUS_INTERFACE_PATH"
        )
    else:
        return
    raise ModuleNotFoundError(text, name=name)


# --- aliases


class _Alias:
    """Loads an existing module under another name: both names are the same module."""

    def __init__(self, target: str) -> None:
        self._target = target
        self._spec: ModuleSpec | None = None

    def create_module(self, spec: ModuleSpec) -> ModuleType:
        module = import_at_once(self._target)
        self._spec = module.__spec__
        return module

    def exec_module(self, module: ModuleType) -> None:
        name = module.__spec__.name if module.__spec__ else ""
        module.__spec__ = self._spec  # the import has changed it
        self._load_hidden_parts(name, module)

    def _load_hidden_parts(self, name: str, module: ModuleType) -> None:
        """Load parts named like a function of the package: a later import would replace the function."""
        for alias, target in _ALIASES.items():
            package, _, part = alias.rpartition(".")
            if package == name and callable(getattr(module, part, None)):
                sys.modules.setdefault(alias, import_at_once(target))

    def get_code(self, name: str) -> CodeType | None:
        """For `python -m`."""
        from importlib.util import find_spec

        spec = find_spec(self._target)
        loader: Any = None if spec is None else spec.loader
        code: CodeType | None = loader.get_code(self._target)
        return code


def _alias(name: str, target: str) -> ModuleSpec | None:
    from importlib.util import find_spec  # late: most programs that import messages do not need it

    if target not in sys.modules and find_spec(target) is None:
        return None
    return spec_of(name, _Alias(target), is_package=False)


def _class_file(name: str) -> ModuleSpec | None:
    package, _, file = name.rpartition(".")
    if package not in _WITH_CLASS_FILES:
        return None
    module = import_module(package)
    classes = {one.lower() for one in module.__all__}
    return _alias(name, module.__name__) if file.replace("_", "") in classes else None


# --- modules made here


def _fill_empty(module: ModuleType) -> None:
    """Make an empty package; its parts come at import or on access: `import std_msgs; std_msgs.msg.Bool`.

    In ROS 2 a part exists once any module has imported it, and rclpy imports the parts of many packages.
    """
    vars(module).update(__getattr__=partial(_part, module.__name__))


def _part(package: str, name: str) -> ModuleType:
    if name in _KINDS and _spec(f"{package}.{name}") is not None:
        return import_module(f"{package}.{name}")
    raise AttributeError(f"module '{package}' has no attribute '{name}'")


def _fill_package(sources: tuple[str, ...], module: ModuleType) -> None:
    found: dict[str, Any] = {}
    for source in sources:
        names = vars(import_module(source))
        found.update({name: names[name] for name in names["__all__"]})
    vars(module).update(found, __all__=sorted(found))
    for name in found:
        # A later import of this part must not replace the function of its name.
        if (part := f"{module.__name__}.{name}") in _ALIASES:
            sys.modules[part] = import_module(_ALIASES[part])


def _fill_types(package: str, kind: str, known: list[str], module: ModuleType) -> None:
    """Fill a module with classes, each made at its first use: most packages have many that are never used."""
    vars(module).update(
        __all__=known,
        __dir__=lambda: sorted({*vars(module), *known}),
        __getattr__=partial(_type, module, package, kind, known),
    )


def _type(module: ModuleType, package: str, kind: str, known: list[str], name: str) -> Any:
    whole, _, part = name.partition("_")
    if name not in known and not (whole in known and part in _parts(kind)):
        _no_type(module, known, name)
    from bus_ros.rosidl import action_class, message_class, service_class

    makers: dict[str, Any] = {"msg": message_class, "srv": service_class, "action": action_class}
    make = makers[kind] if name in known else message_class
    made = make(f"{package}/{kind}/{name}")
    setattr(module, name, made)
    return made


def _parts(kind: str) -> tuple[str, ...]:
    from bus.types.idl import CARRIERS, PARTS

    others: dict[str, tuple[str, ...]] = {"srv": ("Event",), "action": tuple(CARRIERS)}
    return (*PARTS.get(kind, ()), *others.get(kind, ()))


def _no_type(module: ModuleType, known: list[str], name: str) -> NoReturn:
    if not name.startswith("__") and _is_import(sys._getframe(2)):
        from bus.base.suggest import did_you_mean

        text = f"cannot import name '{name}' from '{module.__name__}'{did_you_mean(name, known)}"
        raise ImportError(text, name=module.__name__)
    raise AttributeError(f"module '{module.__name__}' has no attribute '{name}'")


def _is_import(frame: FrameType) -> bool:
    """Whether the frame executes `from ... import ...`: its error is ImportError."""
    from opcode import opmap

    return frame.f_lasti >= 0 and frame.f_code.co_code[frame.f_lasti] == opmap.get("IMPORT_FROM")


install(force=os.environ.get("BUS_RCLPY_FORCE") == "1")
