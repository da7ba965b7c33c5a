"""Command lines: remap rules, parameters, their files and order, and the errors of wrong ones."""

import tempfile
from pathlib import Path

import rclpy
from rclpy.node import Node
from rclpy.parameter import parameter_dict_from_yaml_file, parameter_value_to_python
from rclpy.utilities import remove_ros_args
from show import name_of

folder = Path(tempfile.mkdtemp())
BARE = {"enable_rosout": False, "start_parameter_services": False}
OWN = ("use_sim_time", "start_type_description_service")


def file_of(text, name="p.yaml"):
    path = folder / name
    path.write_text(text)
    return str(path)


def shown(node, names):
    values = {name: one.value for name, one in node._parameters.items() if name not in OWN}
    return values, [(node.resolve_topic_name(name), node.resolve_service_name(name)) for name in names]


def run(label, words, own=None, namespace="/", names=()):
    """Make a node with this command line; print its parameters and names, or the error's class."""
    context = rclpy.context.Context()
    try:
        rclpy.init(args=["program", *words], context=context)
    except Exception as error:
        print(f"{label}: init: {name_of(error)}")
        return
    options = {"allow_undeclared_parameters": True, "automatically_declare_parameters_from_overrides": True}
    try:
        node = Node("node", context=context, namespace=namespace, cli_args=own, **options, **BARE)
        print(f"{label}: {node.get_fully_qualified_name()} {shown(node, names)}")
        node.destroy_node()
    except Exception as error:
        print(f"{label}: node: {name_of(error)}")
    finally:
        context.try_shutdown()


ROS = "--ros-args"
NAMES = ("foo", "bar", "~/foo", "in/foo")
for rule in (
    *("foo:=bar", "rostopic://foo:=bar", "rosservice://foo:=bar", "rostopic:///foo:=bar"),
    *("rostopic://~/foo:=bar", "node:rosservice://foo:=~/bar", "other:rostopic://foo:=bar"),
    *("rostopic:foo:=bar", "rosaction://foo:=bar", "http://foo:=bar", "rostopic://:=bar", "rostopic://foo"),
    *("rostopic://foo:=rostopic://bar", "rosservice://__ns:=/x", "rostopic://__node:=x", "foo:=", "a:=b:=c"),
    *(
        "__ns:=/x",
        "__ns:=x",
        "__node:=x",
        "__name:=x",
        "__node:=/x",
        "rostopic://1a:=b",
        "rostopic://foo:=/a//b",
    ),
):
    run(f"-r {rule}", [ROS, "-r", rule], names=NAMES)
run("topic's rule is later", [ROS, "-r", "foo:=a", "-r", "rostopic://foo:=b"], names=NAMES)
run("topic's rule is first", [ROS, "-r", "rostopic://foo:=b", "-r", "foo:=a"], names=NAMES)
run("no --ros-args", ["foo:=bar", "__node:=x", "_p:=1", "model:=/a/b.urdf"], names=NAMES)
run("after --", [ROS, "-r", "foo:=a", "--", "bar:=b", "x"], names=NAMES)
run("no -r", [ROS, "foo:=bar"])
print(remove_ros_args(["program", "foo:=bar", "model:=/a/b.urdf", ROS, "-p", "a:=1", "--", "x"]))

for value in (
    *("null", "~", "Null", "''", "!!null x", "[null]", "[a, ~]", "[1, ~]", "[1, a]", "{a: 1}", "a: 1", ""),
    *("y", "off", "0x1F", "017", "0o17", "1_000", "1:30", "2001-01-01", ".inf", "1e5", "1.", "+1", "'5'"),
    *("99999999999999999999", "[1, 2]", "[a, '1']", "1 # a comment", "&a 1"),
):
    run(f"-p a:={value}", [ROS, "-p", f"a:={value}"])
for value in ("null", "~", "[~]", "'null'", ""):
    text = f"/**:\n  ros__parameters:\n    a: {value}\n    b: 1\n"
    run(f"file, a: {value}", [ROS, "--params-file", file_of(text)])

FILES = {
    "name": "node:\n  ros__parameters:\n    a: name\n",
    "full name": "/node:\n  ros__parameters:\n    a: full name\n",
    "all": "/**:\n  ros__parameters:\n    a: all\n",
    "star": "/*:\n  ros__parameters:\n    a: star\n",
    "name anywhere": "/**/node:\n  ros__parameters:\n    a: name anywhere\n",
}
GIVEN = {name: ["--params-file", file_of(text, f"{name}.yaml")] for name, text in FILES.items()}
GIVEN["-p"] = ["-p", "a:=-p"]
GIVEN["-p node"] = ["-p", "node:a:=-p node"]
for first in GIVEN:
    for second in GIVEN:
        run(f"{first}, {second}", [ROS, *GIVEN[first], *GIVEN[second]])
        run(f"{first}, the node's own {second}", [ROS, *GIVEN[first]], own=[ROS, *GIVEN[second]])
for several in (
    *(("name", "-p", "all"), ("all", "name", "-p"), ("-p", "all", "name"), ("-p", "name", "-p")),
    *(("all", "-p", "name", "-p node"), ("name", "-p node", "-p"), ("-p node", "all", "name")),
):
    run(", ".join(several), [ROS, *(word for one in several for word in GIVEN[one])])
for given in GIVEN:
    run(f"{given} in a namespace", [ROS, *GIVEN[given]], namespace="/x")

for label, text in {
    "another node's": "other:\n  ros__parameters:\n    a: 1\n",
    "another node's null": "other:\n  ros__parameters:\n    a: null\n",
    "another node's wrong": "other:\n  ros__parameters:\n    a: [1, x]\n",
    "flat": "a: 1\n",
    "empty": "",
    "comment": "# nothing\n",
    "no YAML": "a: [\n",
    "list": "- a\n",
    "no name": "ros__parameters:\n  a: 1\n",
    "no parameters": "node:\n  ros__parameters: {}\n",
    "no section": "node:\n",
    "value beside": "node:\n  ros__parameters:\n    a: 1\nother:\n  x: 1\n",
    "twice": "node:\n  ros__parameters:\n    a: 1\n    b: 1\nnode:\n  ros__parameters:\n    b: 2\n",
    "nested": "node:\n  ros__parameters:\n    a: {b: {c: 1}, d: 2}\n",
    "alias": "node:\n  ros__parameters:\n    a: &x 1\n    b: *x\n",
    "odd names": "node:\n  ros__parameters:\n    a b: 1\n    c-d: 1\n",
}.items():
    run(f"file: {label}", [ROS, "--params-file", file_of(text)])
for label, words in {
    "missing file": [ROS, "--params-file", str(folder / "nosuch.yaml")],
    "folder": [ROS, "--params-file", str(folder)],
    "wrong rule": [ROS, "-r", "a"],
    "wrong parameter": [ROS, "-p", "a"],
    "wrong level": [ROS, "--log-level", "x"],
    "nothing after -p": [ROS, "-p"],
    "unknown": [ROS, "-x", "a"],
}.items():
    run(label, words)
    run(f"the node's own: {label}", [], own=words)


def load(label, path, **options):
    """Read a file as parameter clients do."""
    try:
        found = parameter_dict_from_yaml_file(path, **options)
    except Exception as error:
        print(f"{label}: {name_of(error)}")
        return
    print(f"{label}: {[(name, parameter_value_to_python(one.value)) for name, one in found.items()]}")


THREE = file_of(
    "/node:\n  ros__parameters:\n    a: node\n"
    "/**:\n  ros__parameters:\n    a: all\n    w: 1\n"
    "/o/other:\n  ros__parameters:\n    b: {c: 1, d: [true]}\n",
    "three.yaml",
)
for nodes in (["/node"], ["/o/other"], ["/node", "/o/other"], ["/nosuch"]):
    load(f"load {nodes}", THREE, target_nodes=nodes)
    load(f"load {nodes} and /**", THREE, target_nodes=nodes, use_wildcard=True)
load("load /o/other as", THREE, target_nodes=["/o/other"], namespace="x.")
load("load only /**", file_of(FILES["all"]))
load("load /** with use_wildcard", file_of(FILES["all"]), use_wildcard=True)
load("load a missing file", str(folder / "nosuch.yaml"))
load("load a folder", str(folder))
load("load a flat file", file_of("a: 1\n"))
load("load an empty list", file_of("node:\n  ros__parameters:\n    a: []\n"))
