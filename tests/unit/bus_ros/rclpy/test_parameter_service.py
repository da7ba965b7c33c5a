"""The services of a node's parameters, and a client for another node's parameters."""

from pathlib import Path
from typing import Any, cast

import pytest

from bus_ros.rclpy.impl.node_parameters import NodeParameters
from bus_ros.rclpy.parameter import Parameter, parameter_value_to_python
from bus_ros.rclpy.parameter_client import AsyncParameterClient
from bus_ros.rclpy.parameter_service import ParameterService
from bus_ros.rosidl import message_class

Type = Parameter.Type


def descriptor(**fields: Any) -> Any:
    return message_class("rcl_interfaces/msg/ParameterDescriptor")(**fields)


def result(successful: bool, reason: str = "") -> Any:
    return message_class("rcl_interfaces/msg/SetParametersResult")(successful=successful, reason=reason)  # type: ignore[call-arg]


class Host:
    """The parts of a node that a ParameterService needs: its name, its parameters, and a place for
    services.
    """

    def __init__(self, parameters: NodeParameters) -> None:
        self._parameters = parameters
        self.services: dict[str, tuple[Any, Any]] = {}

    def get_name(self) -> str:
        return "node"

    def create_service(self, kind: Any, name: str, callback: Any, **options: Any) -> str:
        assert options["qos_profile"].depth == 1000
        self.services[name] = (kind, callback)
        return name

    def call(self, topic: str, **fields: Any) -> Any:
        kind, callback = self.services[f"node/{topic}"]
        return callback(kind.Request(**fields), kind.Response())

    def __getattr__(self, name: str) -> Any:
        return getattr(self._parameters, name)


@pytest.fixture
def host() -> Host:
    parameters = NodeParameters()
    parameters.declare_parameter("a", 1, descriptor(description="d"))
    parameters.declare_parameter("unset", Type.STRING)
    parameters.declare_parameter("b.c", "x")
    host = Host(parameters)
    ParameterService(host)
    return host


def test_services(host: Host) -> None:
    assert set(host.services) == {
        f"node/{topic}"
        for topic in (
            "describe_parameters",
            "get_parameter_types",
            "get_parameters",
            "list_parameters",
            "set_parameters",
            "set_parameters_atomically",
        )
    }
    values = host.call("get_parameters", names=["a", "nosuch", "unset", "b.c"]).values
    assert [parameter_value_to_python(one) for one in values] == [1, None, None, "x"]
    assert list(host.call("get_parameter_types", names=["a", "nosuch", "b.c"]).types) == [2, 0, 4]
    described = host.call("describe_parameters", names=["a", "nosuch"]).descriptors
    assert [(one.name, one.description) for one in described] == [("a", "d"), ("", "")]
    assert host.call("list_parameters", prefixes=["b"], depth=1).result.names == ["b.c"]


def test_services_that_set(host: Host) -> None:
    wanted = [Parameter("a", value=2), Parameter("nosuch", value=1), Parameter("b.c", value=1)]
    results = host.call("set_parameters", parameters=[one.to_parameter_msg() for one in wanted]).results
    assert [one.successful for one in results] == [True, False, False]
    assert "Invalid access to undeclared parameter(s)" in results[1].reason
    assert host.get_parameter("a").value == 2
    one = host.call("set_parameters_atomically", parameters=[each.to_parameter_msg() for each in wanted[:2]])
    assert not one.result.successful
    broken = wanted[0].to_parameter_msg()
    broken.value.type = 77
    for topic in ("set_parameters", "set_parameters_atomically"):
        answer = host.call(topic, parameters=[broken])
        refused = answer.results[0] if topic == "set_parameters" else answer.result
        assert refused == result(False, "unexpected parameter type 77")


class FakeFuture:
    def __init__(self, response: Any) -> None:
        self.response = response

    def result(self) -> Any:
        return self.response

    def add_done_callback(self, callback: Any) -> None:
        callback(self)


class FakeClient:
    """Calls the service of a Host at once."""

    def __init__(self, host: Host, kind: Any, name: str) -> None:
        self.srv_type = kind
        self._callback = host.services[name.removeprefix("/")][1]
        self.is_ready = True
        self.waited: list[float | None] = []

    def service_is_ready(self) -> bool:
        return self.is_ready

    def wait_for_service(self, timeout_sec: float | None = None) -> bool:
        self.waited.append(timeout_sec)
        return self.is_ready

    def call_async(self, request: Any) -> FakeFuture:
        return FakeFuture(self._callback(request, self.srv_type.Response()))


class Caller:
    """A node. Its clients reach one Host."""

    def __init__(self, host: Host) -> None:
        self._host = host
        self.clients: list[FakeClient] = []

    def create_client(self, kind: Any, name: str, **options: Any) -> FakeClient:
        self.clients.append(FakeClient(self._host, kind, name))
        return self.clients[-1]


def test_client(host: Host, tmp_path: Path) -> None:
    client = AsyncParameterClient(cast(Any, Caller(host)), "/node")
    done: list[Any] = []
    assert client.list_parameters().result().result.names == ["a", "unset", "b.c"]
    assert client.list_parameters(["b"], 1, done.append).result().result.names == ["b.c"]
    assert client.get_parameters(["a"]).result().values[0].integer_value == 1
    assert list(client.get_parameter_types(["a"]).result().types) == [2]
    assert client.describe_parameters(["a"]).result().descriptors[0].description == "d"
    wanted = [Parameter("a", value=5), Parameter("b.c", value="y").to_parameter_msg()]
    assert [one.successful for one in client.set_parameters(wanted).result().results] == [True, True]
    assert client.set_parameters_atomically(wanted).result().result.successful
    assert not client.delete_parameters(["a"]).result().results[0].successful
    path = tmp_path / "f.yaml"
    path.write_text("/node: {ros__parameters: {a: 7, b: {c: z}}}\n/**: {ros__parameters: {a: 1}}\n")
    assert len(client.load_parameter_file(path, callback=done.append).result().results) == 2
    assert [host.get_parameter(name).value for name in ("a", "b.c")] == [7, "z"]
    path.write_text("/another: {ros__parameters: {a: 8}}\n")  # in ROS 2, all sections are for the node
    assert client.load_parameter_file_atomically(path).result().result.successful
    assert host.get_parameter("a").value == 8 and len(done) == 2


def test_client_waits(host: Host) -> None:
    caller = Caller(host)
    client = AsyncParameterClient(cast(Any, caller), "node")
    assert client.services_are_ready()
    assert client.wait_for_services()
    assert client.wait_for_services(5.0)
    caller.clients[-1].is_ready = False
    assert not client.services_are_ready()
    assert not client.wait_for_services(0.0)
    for one in caller.clients:
        unlimited, limited, zero = one.waited
        assert unlimited is None
        assert limited is not None and 0.0 <= limited <= 5.0
        assert zero == 0.0
