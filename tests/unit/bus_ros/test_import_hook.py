"""The import hook: ROS 2's names in a user's program, on a machine without ROS 2."""

import subprocess
import sys
from pathlib import Path
from textwrap import dedent

import pytest

import bus


@pytest.fixture
def workspace(tmp_path: Path) -> Path:
    """A colcon workspace with a package of definitions."""
    package = tmp_path / "src" / "my_interfaces"
    for path, text in {
        "package.xml": "<package><name>my_interfaces</name></package>",
        "msg/Wheel.msg": "float64 speed\ngeometry_msgs/Point[] contacts\n",
        "msg/Broken.msg": "Int32 x\n",
        "srv/Turn.srv": "float64 angle\n---\nbool ok\n",
    }.items():
        (package / path).parent.mkdir(parents=True, exist_ok=True)
        (package / path).write_text(text)
    return tmp_path


def start(code: str, folder: Path, **environment: str) -> subprocess.CompletedProcess[str]:
    path = [str(folder), str(Path(bus.__file__).parents[1])]
    return subprocess.run(
        [sys.executable, "-W", "error", "-c", dedent(code)],
        env={"PATH": "", "PYTHONPATH": ":".join(path), "PYTHONDONTWRITEBYTECODE": "1", **environment},
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=60,
    )


def run(code: str, folder: Path, **environment: str) -> list[str]:
    done = start("import bus.rclpy_compat\n" + dedent(code), folder, **environment)
    assert done.returncode == 0, done.stderr
    return done.stdout.splitlines()


def error_of(code: str, folder: Path) -> str:
    done = start("import bus.rclpy_compat\n" + dedent(code), folder)
    assert done.returncode == 1, done.stdout
    return done.stderr.splitlines()[-1]


def test_the_ways_to_import_a_message(tmp_path: Path) -> None:
    code = """
        from std_msgs.msg import String, Header as H
        import std_msgs.msg, geometry_msgs.msg as g
        from std_msgs.msg._string import String as Same
        from std_srvs.srv import SetBool
        from std_srvs.srv._set_bool import SetBool_Request
        from example_interfaces.action import Fibonacci
        from example_interfaces.action._fibonacci import Fibonacci_FeedbackMessage, Fibonacci_Goal
        assert (Fibonacci_FeedbackMessage, Fibonacci_Goal) == (Fibonacci.Impl.FeedbackMessage, Fibonacci.Goal)
        assert String is std_msgs.msg.String is Same
        assert SetBool_Request is SetBool.Request
        print(String(data="x"), g.Point(), SetBool.Request(data=True), Fibonacci.Goal().order, H().frame_id)
        print(sorted(set(dir(std_msgs.msg)) & {"String", "Int32", "Strin"}), "String" in std_msgs.msg.__all__)
        from std_msgs.msg import *
        print(Int32, type(Empty()).__module__)
    """
    assert run(code, tmp_path) == [
        "std_msgs.msg.String(data='x') geometry_msgs.msg.Point(x=0.0, y=0.0, z=0.0) "
        "std_srvs.srv.SetBool_Request(data=True) 0 ",
        "['Int32', 'String'] True",
        "<class 'std_msgs.msg._int32.Int32'> std_msgs.msg._empty",
    ]


def test_definitions_of_a_workspace(workspace: Path) -> None:
    code = """
        from my_interfaces.msg import Wheel
        from my_interfaces.srv import Turn
        print(Wheel(speed=1.0), Turn.Response(ok=True), type(Wheel().contacts).__name__)
    """
    # In src, Python takes the package's folder for an empty package.
    for folder in (workspace, workspace / "src", workspace / "src" / "my_interfaces"):
        assert run(code, folder) == [
            "my_interfaces.msg.Wheel(speed=1.0, contacts=[]) my_interfaces.srv.Turn_Response(ok=True) list"
        ]


def test_a_malformed_definition_is_an_error_when_it_is_asked_for(workspace: Path) -> None:
    assert run("import my_interfaces.msg as m; print(len(m.__all__))", workspace) == ["2"]
    error = error_of("from my_interfaces.msg import Broken", workspace)
    assert "ConfigurationError" in error and "my_interfaces/msg/Broken.msg:1" in error


def test_a_package_with_code_of_its_own_keeps_it(workspace: Path) -> None:
    code = workspace / "src" / "my_interfaces" / "my_interfaces"
    code.mkdir()
    (code / "__init__.py").write_text("SPEED = 5\n")
    (code / "node.py").write_text("from my_interfaces.msg import Wheel\n")
    lines = run(
        "import my_interfaces, my_interfaces.node as n; print(my_interfaces.SPEED, n.Wheel.__name__)",
        code.parent,
    )
    assert lines == ["5 Wheel"]


def test_a_real_message_package_is_left_alone_unless_forced(tmp_path: Path) -> None:
    real = tmp_path / "std_msgs" / "msg"
    real.mkdir(parents=True)
    (real.parent / "__init__.py").touch()
    (real / "__init__.py").write_text("class String:\n    pass\n")
    code = "from std_msgs.msg import String; from std_srvs.srv import SetBool; print(String.__module__)"
    assert run(code, tmp_path) == ["std_msgs.msg"]
    assert run(code, tmp_path, BUS_RCLPY_FORCE="1") == ["std_msgs.msg._string"]
    assert run(f"bus.rclpy_compat.install(force=True); {code}", tmp_path) == ["std_msgs.msg._string"]


def test_a_real_rclpy_is_left_alone_unless_forced(tmp_path: Path) -> None:
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy" / "__init__.py").write_text("IS_REAL = True\n")
    (tmp_path / "rclpy" / "node.py").write_text("class Node: pass\n")
    code = """
        import rclpy
        from rclpy.node import Node
        print(rclpy.IS_REAL, Node.__module__)
        try:
            import rclpy.qos
        except ModuleNotFoundError as error:
            print(error)
    """
    assert run(code, tmp_path) == ["True rclpy.node", "No module named 'rclpy.qos'"]
    forced = "import rclpy.qos, sys; print(rclpy is sys.modules['bus_ros.rclpy'])"
    assert run(forced, tmp_path, BUS_RCLPY_FORCE="1") == ["True"]


def test_rclpy_has_the_same_modules_under_both_names(tmp_path: Path) -> None:
    code = """
        import sys
        import rclpy
        import bus_ros.rclpy.qos
        print(rclpy is bus_ros.rclpy, rclpy.qos is bus_ros.rclpy.qos, rclpy.__name__, rclpy.__spec__.name)
        import rclpy.time
        from rclpy import duration, exceptions
        from rclpy.impl import rcutils_logger
        import rclpy.impl.rcutils_logger as same
        for name in ("time", "impl.rcutils_logger"):
            assert sys.modules["rclpy." + name] is sys.modules["bus_ros.rclpy." + name]
        print(rclpy.time is bus_ros.rclpy.time, same is rcutils_logger, hasattr(rclpy, "nothing"))
    """
    assert run(code, tmp_path) == ["True True bus_ros.rclpy bus_ros.rclpy", "True True False"]


def test_modules_that_only_have_names_of_others(tmp_path: Path) -> None:
    code = """
        import inspect, pickle, sys
        from rclpy.qos_event import SubscriptionEventCallbacks
        from rclpy.validate_node_name import validate_node_name
        from rclpy.experimental.events_executor import EventsExecutor
        from rclpy.clock_type import *
        import rclpy.event_handler, rclpy.experimental, rclpy.constants
        import bus_ros.rclpy.qos_event as same
        assert same is rclpy.qos_event is sys.modules["rclpy.qos_event"]
        assert SubscriptionEventCallbacks is rclpy.event_handler.SubscriptionEventCallbacks
        assert EventsExecutor is rclpy.experimental.EventsExecutor is rclpy.executors.EventsExecutor
        print(inspect.signature(validate_node_name), inspect.getsource(validate_node_name).splitlines()[0])
        print(pickle.loads(pickle.dumps(validate_node_name)) is validate_node_name, rclpy.constants.S_TO_NS)
        print(pickle.loads(pickle.dumps(ClockType.ROS_TIME)), rclpy.qos_event.__spec__.name)
        print(inspect.getdoc(same))
    """
    assert run(code, tmp_path) == [
        "(node_name: str) -> bool def validate_node_name(node_name: str) -> bool:",
        "True 1000000000",
        "1 bus_ros.rclpy.qos_event",
        "Names of `rclpy.event_handler`, where programs of ROS 2 look for them, too.",
    ]


def test_the_c_extension_is_there_without_an_import(tmp_path: Path) -> None:
    code = """
        import rclpy
        inside = rclpy.impl.implementation_singleton.rclpy_implementation
        print(inside.RCLError is rclpy.exceptions.RCLError, hasattr(rclpy.impl, "nothing"))
    """
    assert run(code, tmp_path) == ["True False"]


def test_other_modules_of_ros(tmp_path: Path) -> None:
    code = """
        import rosidl_runtime_py, rosidl_parser.definition, ament_index_python
        from rosidl_runtime_py.utilities import get_message, get_service
        from rosidl_runtime_py.set_message import set_message_fields
        from rosidl_runtime_py.get_interfaces import get_interface_path
        from rosidl_runtime_py.import_message import import_message_from_namespaced_type
        from rosidl_runtime_py.convert import get_message_slot_types
        from rosidl_runtime_py import get_interfaces
        from rosidl_parser.definition import BasicType
        from ament_index_python.packages import get_package_share_directory, PackageNotFoundError
        Point = get_message("geometry_msgs/msg/Point")
        assert Point.SLOT_TYPES[0] == BasicType("double")
        message = Point()
        set_message_fields(message, {"x": 1})
        print(rosidl_runtime_py.message_to_yaml(message, flow_style=True).strip())
        print(get_service("std_srvs/srv/SetBool").__name__)
        try:
            ament_index_python.get_package_share_directory("no_such_package")
        except PackageNotFoundError as error:
            print(str(error).partition(",")[0])
    """
    assert run(code, tmp_path) == [
        "{x: 1.0, y: 0.0, z: 0.0}",
        "SetBool",
        "package 'no_such_package' not found",
    ]


def test_the_python_api_of_tools(tmp_path: Path) -> None:
    """As rosapi and py_trees_ros import it."""
    code = """
        from ros2action.api import get_action_names_and_types
        from ros2interface.api import type_completer
        from ros2node.api import get_absolute_node_name, get_node_names
        from ros2param.api import call_get_parameters, call_set_parameters
        from ros2service.api import get_service_names, get_service_names_and_types
        from ros2topic.api import get_topic_names, get_topic_names_and_types
        import ros2cli.node.strategy, ros2topic.api
        from ros2cli.node import NODE_NAME_PREFIX
        from ros2cli.node.direct import DirectNode
        from rosidl_adapter.parser import parse_message_string
        from rosidl_runtime_py import get_interface_path, get_interfaces
        from rosidl_runtime_py.get_interfaces import get_message_interfaces
        from rosidl_runtime_py.import_message import import_message_from_namespaced_type
        import rosidl_runtime_py, rosidl_runtime_py.get_interfaces
        assert rosidl_runtime_py.get_interfaces is get_interfaces
        assert issubclass(ros2cli.node.strategy.NodeStrategy, DirectNode)
        path = get_interface_path("std_msgs/msg/Header")
        message = parse_message_string("std_msgs", "Header", open(path).read())
        print(NODE_NAME_PREFIX, [f"{field.type} {field.name}" for field in message.fields])
    """
    fields = "['builtin_interfaces/Time stamp', 'string frame_id']"
    assert run(code, tmp_path) == [f"_ros2cli {fields}"]


def test_the_variables_of_ros(tmp_path: Path) -> None:
    code = """
        import os
        print(*(os.environ.get(f"ROS_{name}") for name in ("VERSION", "PYTHON_VERSION", "DISTRO")))
    """
    assert run(code, tmp_path) == ["2 3 jazzy"]
    assert run(code, tmp_path, ROS_DISTRO="humble") == ["2 3 humble"]
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy" / "__init__.py").touch()
    assert run(code, tmp_path) == ["None None None"]
    assert run(code, tmp_path, BUS_RCLPY_FORCE="1") == ["2 3 jazzy"]


def test_the_tools_of_another_rclpy_stay_missing(tmp_path: Path) -> None:
    """busd's work only with busd's nodes."""
    (tmp_path / "rclpy").mkdir()
    (tmp_path / "rclpy" / "__init__.py").touch()
    assert error_of("import ros2topic.api", tmp_path) == "ModuleNotFoundError: No module named 'ros2topic'"


def test_a_folder_with_the_name_of_a_package_does_not_hide_it(tmp_path: Path) -> None:
    (tmp_path / "rosidl_runtime_py").mkdir()
    code = "from rosidl_runtime_py import message_to_yaml as convert; print(convert.__name__)"
    assert run(code, tmp_path) == ["message_to_yaml"]


def test_a_part_of_a_package_is_there_when_it_is_asked_for(tmp_path: Path) -> None:
    code = """
        import sys
        import std_msgs, std_srvs, example_interfaces
        print("std_msgs.msg" in sys.modules, hasattr(std_srvs, "msg"), hasattr(std_msgs, "__all__"))
        print(std_msgs.msg.Bool(data=True), std_srvs.srv.SetBool.Request())
        print(example_interfaces.action.__name__)
        """
    assert run(code, tmp_path) == [
        "False False False",
        "std_msgs.msg.Bool(data=True) std_srvs.srv.SetBool_Request(data=False)",
        "example_interfaces.action",
    ]


MISSING = [
    (
        "from std_msgs.msg import Strin",
        "ImportError: cannot import name 'Strin' from 'std_msgs.msg'; did you mean 'String'?",
    ),
    (
        "import std_msgs.msg; std_msgs.msg.Strin",
        "AttributeError: module 'std_msgs.msg' has no attribute 'Strin'",
    ),
    ("import ros2bag", "ModuleNotFoundError: busd has no 'ros2bag', which is a part of ROS 2"),
    ("import tf2_ros.part", "ModuleNotFoundError: busd has no 'tf2_ros.part'"),
    (
        "from nav9_msgs.msg import A",
        "ModuleNotFoundError: busd has no 'nav9_msgs': there are no definitions",
    ),
    ("import no_such_module", "ModuleNotFoundError: No module named 'no_such_module'"),
    ("import std_srvs.msg", "ModuleNotFoundError: No module named 'std_srvs.msg'"),
    ("import std_msgs.msg._strin", "ModuleNotFoundError: No module named 'std_msgs.msg._strin'"),
    ("import std_msgs; std_msgs.srv", "AttributeError: module 'std_msgs' has no attribute 'srv'"),
    ("from std_msgs import Bool", "ImportError: cannot import name 'Bool' from 'std_msgs'"),
    ("import std_msgs.other", "ModuleNotFoundError: No module named 'std_msgs.other'"),
    ("import rclpy.no_such_part", "ModuleNotFoundError: busd has no 'rclpy.no_such_part'"),
    ("import rclpy.experimental.part", "ModuleNotFoundError: busd has no 'rclpy.experimental.part'"),
    ("import bus.no_such_part", "ModuleNotFoundError: No module named 'bus.no_such_part'"),
]

EACH_IN_A_CHILD = """
import os, sys
for code in {codes!r}:
    if not os.fork():
        exec(code)
        os._exit(0)
    os.wait()
    print("next", file=sys.stderr, flush=True)
"""


def test_what_is_missing_is_said(tmp_path: Path) -> None:
    """Each import is the first of its process."""
    text = EACH_IN_A_CHILD.format(codes=[code for code, _ in MISSING])
    done = start("import bus.rclpy_compat\n" + text, tmp_path)
    assert done.returncode == 0, done.stderr
    *said, rest = done.stderr.split("next\n")
    assert rest == ""
    for (code, error), told in zip(MISSING, said, strict=True):
        assert told.splitlines()[-1].startswith(error), code


def test_installing_twice_does_nothing_more(tmp_path: Path) -> None:
    code = """
        import sys
        before = len(sys.meta_path)
        bus.rclpy_compat.install()
        bus.rclpy_compat.install()
        print(len(sys.meta_path) - before)
    """
    assert run(code, tmp_path) == ["0"]


def test_what_perception_nodes_import(tmp_path: Path) -> None:
    """Each has its own name, is the same module as ours, and imports nothing heavy."""
    code = """
        import sys
        import ament_index_python.packages, cv_bridge, diagnostic_updater, laser_geometry, message_filters
        from ament_index_python.packages import get_package_share_directory
        from cv_bridge.core import CvBridge
        from laser_geometry.laser_geometry import LaserProjection
        from message_filters import ApproximateTimeSynchronizer, Subscriber
        from sensor_msgs.msg import PointField
        from sensor_msgs_py import point_cloud2
        print(cv_bridge.CvBridge is CvBridge, point_cloud2.PointField is PointField)
        print(message_filters is sys.modules["bus_ros.message_filters"])
        print({"numpy", "cv2"} & sys.modules.keys())
    """
    assert run(code, tmp_path) == ["True True", "True", "set()"]


def test_it_imports_little(tmp_path: Path) -> None:
    code = """
        import sys
        large = {"asyncio", "msgspec", "numpy", "importlib.abc", "bus.types.definitions", "bus_ros.rclpy"}
        print(large & {*sys.modules})
    """
    assert run(code, tmp_path) == ["set()"]


LAUNCH = """
import bus.rclpy_compat
import launch, launch.actions.log_info
from launch.conditions.if_condition import IfCondition
from launch.event_handlers.on_process_exit import OnProcessExit
from launch.launch_context import LaunchContext
from launch.launch_description_sources.python_launch_description_source import PythonLaunchDescriptionSource
from launch.some_substitutions_type import SomeSubstitutionsType
from launch.substitutions.path_join_substitution import PathJoinSubstitution
from launch.events.process.process_exited import ProcessExited
from launch.frontend.parse_substitution import parse_if_substitutions
from launch.utilities.type_utils import perform_typed_substitution
import launch_testing.parametrize
from launch_ros.actions.node import Node
from launch_ros.parameter_descriptions import ParameterValue
from launch_xml.launch_description_sources import XMLLaunchDescriptionSource
assert launch.actions.log_info.LogInfo is launch.actions.LogInfo
assert launch.conditions.IfCondition is IfCondition
assert launch.frontend.parse_substitution("a")[0].text == "a"  # a function, as in ROS 2
assert callable(launch_testing.parametrize)
import launch.actions.nothing_of_the_kind
"""


def test_launch_has_the_files_that_it_has_in_ros_2(tmp_path: Path) -> None:
    (tmp_path / "launch").mkdir()  # this folder hides nothing
    error = "ModuleNotFoundError: busd has no 'launch.actions.nothing_of_the_kind', and perhaps launch"
    assert error_of(LAUNCH, tmp_path).startswith(error)


def test_modules_of_other_platforms_cost_nothing(tmp_path: Path) -> None:
    """`subprocess` looks for msvcrt, which is no package of messages."""
    code = "import subprocess, sys; assert 'bus.types.definitions' not in sys.modules; import msvcrt"
    assert error_of(code, tmp_path) == "ModuleNotFoundError: No module named 'msvcrt'"
