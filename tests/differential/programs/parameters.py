"""Parameters of a node: declaring, setting, descriptors, ranges, callbacks and errors."""

import warnings

import rclpy
from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor, SetParametersResult
from rclpy.parameter import Parameter, parameter_dict_from_yaml_file, parameter_value_to_python
from show import attempt

warnings.simplefilter("ignore")
rclpy.init(args=["program", "--ros-args", "-p", "given:=5", "-p", "list:=[1.5, 2.5]"])
node = rclpy.create_node("parameters")
TYPES = Parameter.Type
for name, value in (
    ("int", 1),
    ("text", "a"),
    ("flag", True),
    ("floats", [1.0, 2.0]),
    ("given", 0),
    ("list", [0.0]),
):
    attempt(name, lambda name=name, value=value: node.declare_parameter(name, value).value)
attempt("twice", node.declare_parameter, "int", 2)
attempt("type only", lambda: node.declare_parameter("typed", TYPES.STRING).value)
attempt("uninitialized", node.get_parameter, "typed")
attempt("not declared", node.get_parameter, "nothing")
attempt("or", lambda: node.get_parameter_or("nothing", Parameter("nothing", value=7)).value)
attempt("wrong name", node.declare_parameter, "", 1)
attempt("no value", lambda: node.declare_parameter("bare").value)
attempt("wrong value", node.declare_parameter, "odd", object())
attempt("mixed", Parameter, "mixed", value=[1, "a"])
attempt("disagree", Parameter, "p", TYPES.INTEGER, "text")


def results(*parameters):
    return [(one.successful, one.reason) for one in node.set_parameters(list(parameters))]


def set_it(*parameters):
    attempt("set", results, *parameters)


set_it(Parameter("int", value=2), Parameter("text", value="b"))
set_it(Parameter("int", value="text"))
set_it(Parameter("nothing", value=1))
set_it(Parameter("int", TYPES.NOT_SET))
attempt("atomically", node.set_parameters_atomically, [Parameter("int", value=3), Parameter("text", value=4)])
print(node.get_parameter("int").value)
ranged = ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10, step=2)])
node.declare_parameter("ranged", 2, ranged)
set_it(Parameter("ranged", value=4))
set_it(Parameter("ranged", value=5))
set_it(Parameter("ranged", value=12))
worse = ParameterDescriptor(integer_range=[IntegerRange(from_value=0, to_value=10)])
attempt("out of range", node.declare_parameter, "worse", 11, worse)
floating = ParameterDescriptor(floating_point_range=[FloatingPointRange(from_value=0.0, to_value=1.0)])
node.declare_parameter("floating", 0.5, floating)
set_it(Parameter("floating", value=1.5))
constant = ParameterDescriptor(read_only=True, description="constant")
node.declare_parameter("constant", 1, constant)
set_it(Parameter("constant", value=2))
attempt("undeclare", node.undeclare_parameter, "constant")
attempt("undeclare", node.undeclare_parameter, "text")
attempt("undeclare", node.undeclare_parameter, "text")
print(node.has_parameter("text"))
print(node.describe_parameter("ranged"))
attempt("describe", node.describe_parameter, "nothing")
print([int(one) for one in node.get_parameter_types(["int", "floats"])])
attempt("type", node.get_parameter_type, "nothing")
node.declare_parameters("ns", [("a", 1), ("b.c", "two"), ("d", 3.0, ParameterDescriptor())])
print(sorted((name, one.value) for name, one in node.get_parameters_by_prefix("ns").items()))
attempt("declare again", node.declare_parameters, "ns", [("e", 1), ("a", 2)])
print(node.has_parameter("ns.e"))
print(sorted(node.list_parameters(["ns"], 0).names), sorted(node.list_parameters(["ns"], 1).names))
attempt("descriptor", lambda: node.set_descriptor("int", ParameterDescriptor(description="new")).value)
order = []


def pre(parameters):
    order.append(("pre", [one.name for one in parameters]))
    return [*parameters, Parameter("flag", value=False)]


def on(parameters):
    order.append(("on", [one.name for one in parameters]))
    return SetParametersResult(successful=all(one.value != 13 for one in parameters), reason="no 13")


def post(parameters):
    order.append(("post", [one.name for one in parameters]))


node.add_pre_set_parameters_callback(pre)
node.add_on_set_parameters_callback(on)
node.add_post_set_parameters_callback(post)
set_it(Parameter("int", value=4))
set_it(Parameter("int", value=13))
print(order, node.get_parameter("flag").value, node.get_parameter("int").value)
node.remove_pre_set_parameters_callback(pre)
node.remove_on_set_parameters_callback(on)
attempt("removed", node.remove_on_set_parameters_callback, on)
for returned in (None, True, "fine"):

    def odd(parameters, returned=returned):
        return returned

    node.add_on_set_parameters_callback(odd)
    set_it(Parameter("int", value=6))
    attempt("refused", node.declare_parameter, "refused", 1)
    node.remove_on_set_parameters_callback(odd)
attempt("descriptor only", node.declare_parameter, "bare", descriptor=ParameterDescriptor(type=4))
attempt("depth", node.list_parameters, [], None)
attempt("no file", parameter_dict_from_yaml_file, "nosuch.yaml")
message = Parameter("list", value=[1, 2]).to_parameter_msg()
print(
    message.value.type, list(message.value.integer_array_value), Parameter.from_parameter_msg(message).value
)
print(parameter_value_to_python(message.value), Parameter("x", value=3) == Parameter("x", value=3))
rclpy.shutdown()
