"""Lifecycle nodes of the facade: callbacks and their consequences, publishers, services, events."""

from typing import Any

import pytest

from bus_ros.rclpy import lifecycle
from bus_ros.rclpy.callback_groups import ReentrantCallbackGroup
from bus_ros.rclpy.exceptions import RCLError
from bus_ros.rclpy.lifecycle import LifecycleNode, LifecycleNodeMixin, State, TransitionCallbackReturn
from bus_ros.rclpy.lifecycle.managed_entity import LifecycleState, ManagedEntity, SimpleManagedEntity
from bus_ros.rclpy.node import Node
from bus_ros.rclpy.parameter import Parameter
from bus_ros.rclpy.publisher import Publisher
from bus_ros.rclpy.type_description_service import START_TYPE_DESCRIPTION_SERVICE_PARAM
from bus_ros.rosidl import message_class, service_class
from conftest import WAIT_S
from rclpy_world import String, World, arguments, arrived, world
from rows import for_each

__all__ = ["arguments", "world"]

SUCCESS, FAILURE, ERROR = TransitionCallbackReturn
NAMES = ("configure", "activate", "deactivate", "cleanup", "shutdown")


class Managed(LifecycleNode):
    """Without the services for parameters and type descriptions."""

    def __init__(self, **options: Any) -> None:
        off = Parameter(START_TYPE_DESCRIPTION_SERVICE_PARAM, value=False)
        super().__init__("lc", start_parameter_services=False, parameter_overrides=[off], **options)


class Recorder(Managed):
    """Records the calls of callbacks; `results` holds the value or exception for each."""

    def __init__(self, **options: Any) -> None:
        self.called: list[tuple[str, str]] = []
        self.results: dict[str, Any] = {}
        super().__init__(**options)

    def _on(self, name: str, state: State) -> TransitionCallbackReturn:
        self.called.append((name, state.label))
        result = self.results.get(name, SUCCESS)
        if isinstance(result, Exception):
            raise result
        return result  # type: ignore[no-any-return]

    def on_configure(self, state: State) -> TransitionCallbackReturn:
        return self._on("configure", state)

    def on_cleanup(self, state: State) -> TransitionCallbackReturn:
        return self._on("cleanup", state)

    def on_shutdown(self, state: State) -> TransitionCallbackReturn:
        return self._on("shutdown", state)

    def on_activate(self, state: State) -> TransitionCallbackReturn:
        return self._on("activate", state)

    def on_deactivate(self, state: State) -> TransitionCallbackReturn:
        return self._on("deactivate", state)

    def on_error(self, state: State) -> TransitionCallbackReturn:
        return self._on("error", state)

    @property
    def state(self) -> str:
        return self._state_machine.current_state[1]


@pytest.fixture
def node(world: World) -> Recorder:
    made = Recorder()
    world.keep(made)
    return made


class Caller:
    """Another node, which calls the services of `node`."""

    def __init__(self, world: World, node: Node) -> None:
        self._world, self._node, self._asking = world, node, world.node("asking")

    def ask(self, service: str, srv_type: str, **fields: Any) -> Any:
        definition: Any = service_class(f"lifecycle_msgs/srv/{srv_type}")
        client = self._asking.create_client(definition, f"/lc/{service}")
        assert client.wait_for_service(timeout_sec=WAIT_S)
        future = client.call_async(definition.Request(**fields))
        self._world.spin_until(future.done, self._node, self._asking)
        return future.result()

    def change(self, **transition: Any) -> bool:
        message = message_class("lifecycle_msgs/msg/Transition")(**transition)
        return bool(self.ask("change_state", "ChangeState", transition=message).success)


@pytest.fixture
def caller(world: World, node: Recorder) -> Caller:
    return Caller(world, node)


def trigger(node: LifecycleNodeMixin, name: str) -> TransitionCallbackReturn:
    result: TransitionCallbackReturn = getattr(node, f"trigger_{name}")()
    return result


def test_a_life(node: Recorder) -> None:
    for name in ("configure", "activate", "deactivate", "cleanup", "shutdown"):
        assert trigger(node, name) is SUCCESS
    assert node.called == [
        *(("configure", "unconfigured"), ("activate", "inactive"), ("deactivate", "active")),
        *(("cleanup", "inactive"), ("shutdown", "unconfigured")),
    ]
    assert node.state == "finalized"


# (Callback's result, on_error's result): the states that follow, from on_configure to on_shutdown.
ENDS: dict[tuple[Any, Any], tuple[str, ...]] = {
    (SUCCESS, None): ("inactive", "active", "inactive", "unconfigured", "finalized"),
    (FAILURE, None): ("unconfigured", "inactive", "active", "inactive", "finalized"),
    (ERROR, SUCCESS): ("unconfigured",) * 5,
    (ERROR, FAILURE): ("finalized",) * 5,
    (ERROR, ERROR): ("finalized",) * 5,
    (ERROR, ValueError("no")): ("finalized",) * 5,
    (ValueError("no"), SUCCESS): ("unconfigured",) * 5,
}
BEFORE = {"configure": (), "activate": ("configure",), "deactivate": ("configure", "activate")}


def test_where_each_result_leads(world: World, capfd: pytest.CaptureFixture[str]) -> None:
    for (result, of_error), ends in ENDS.items():
        for name, end in zip(NAMES, ends, strict=True):
            node = Recorder(enable_communication_interface=False)
            for earlier in BEFORE.get(name, ("configure",)):
                trigger(node, earlier)
            before = node.state
            node.called.clear()
            node.results = {name: result, "error": of_error}
            returned = trigger(node, name)
            assert returned is (ERROR if isinstance(result, Exception) else result)
            assert node.state == end, (name, result, of_error)
            assert node.called == [(name, before), *([("error", before)] if returned is ERROR else [])]
            node.destroy_node()
    assert capfd.readouterr().err.count("ValueError: no") == 10


@for_each("result", [None, True, 97, "SUCCESS"])
def test_a_callback_that_returns_something_else(world: World, result: object) -> None:
    node = Recorder()
    world.keep(node)
    node.results["configure"] = result
    with pytest.raises(TypeError) as wrong:
        node.trigger_configure()
    what = type(result).__name__
    assert str(wrong.value) == (
        f"on_configure() of node '/lc' must return a TransitionCallbackReturn, not {what}"
    )
    node.destroy_node()


def test_what_a_callback_raises_is_logged(node: Recorder, capfd: pytest.CaptureFixture[str]) -> None:
    """The traceback has the program's own lines."""
    node.results["configure"] = ValueError("no")
    assert node.trigger_configure() is ERROR
    first, second, third, *_, last = capfd.readouterr().err.splitlines()
    assert first.endswith("[lc]: on_configure() raised, which counts as ERROR:")
    assert second == "Traceback (most recent call last):"
    assert __file__ in third
    assert last == "ValueError: no"


def test_what_is_not_possible(node: Recorder, capfd: pytest.CaptureFixture[str]) -> None:
    for name in ("activate", "deactivate", "cleanup"):
        with pytest.raises(RCLError, match="Transition is not registered"):
            trigger(node, name)
    assert "[rcl_lifecycle]: No transition matching 3 found for current state unconfigured" in (
        capfd.readouterr().err
    )
    node.trigger_shutdown()
    with pytest.raises(RCLError, match="Shutdown transtion not possible"):
        node.trigger_shutdown()
    assert node.called == [("shutdown", "unconfigured")]


def test_a_publisher_follows_its_node(world: World, capfd: pytest.CaptureFixture[str]) -> None:
    node = Managed()
    world.keep(node)
    listener = world.node("listener")
    heard: list[str] = []
    subscription = listener.create_subscription(
        String, "chatter", lambda message: heard.append(message.data), 10
    )
    publisher = node.create_lifecycle_publisher(String, "chatter", 10)
    assert isinstance(publisher, lifecycle.Publisher) and isinstance(publisher, SimpleManagedEntity)
    ordinary = node.create_publisher(String, "chatter", 10)
    node.trigger_configure()
    for step in ("inactive", "activate", "deactivate", "activate"):
        if step != "inactive":
            trigger(node, step)
        assert publisher.is_activated is (step == "activate")
        for _ in range(2):
            publisher.publish(String(data=step))
    ordinary.publish(String(data="ordinary"))
    world.spin_until(lambda: "ordinary" in heard, listener)
    world.spin_until(lambda: len(heard) == 5, listener)
    assert arrived(subscription) == 5
    assert sorted(heard) == ["activate"] * 4 + ["ordinary"]
    warning = (
        "[LifecyclePublisher]: Trying to publish message on the topic '/chatter', "
        "but the publisher is not activated\n"
    )
    assert capfd.readouterr().err.count(warning) == 2
    assert node.destroy_lifecycle_publisher(publisher)
    assert not node.destroy_lifecycle_publisher(publisher)
    with pytest.raises(TypeError, match="unexpected keyword argument 'publisher_class'"):
        node.create_lifecycle_publisher(String, "chatter", 10, publisher_class=lifecycle.Publisher)


def test_a_replaced_publish_of_the_base_gets_the_publisher_and_the_message(
    world: World, monkeypatch: pytest.MonkeyPatch
) -> None:
    node = Managed()
    world.keep(node)
    calls: list[tuple[Any, ...]] = []
    publisher = node.create_lifecycle_publisher(String, "chatter", 10)
    node.trigger_configure()
    node.trigger_activate()
    with monkeypatch.context() as patch:
        patch.setattr(Publisher, "publish", Replacement(calls))
        publisher.publish(String(data="a"))
    assert calls == [(publisher, String(data="a"))]


class Replacement:
    """A callable that is no function: Python does not bind it to the object."""

    def __init__(self, calls: list[tuple[Any, ...]]) -> None:
        self._calls = calls

    def __call__(self, *arguments: Any) -> None:
        self._calls.append(arguments)


class Entity(ManagedEntity):
    """An entity whose callback returns a given result."""

    def __init__(self, result: Any = SUCCESS) -> None:
        self.result, self.heard = result, list[str]()

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        self.heard.append(state.label)
        return self.result  # type: ignore[no-any-return]


def test_managed_entities(world: World, capfd: pytest.CaptureFixture[str]) -> None:
    """They are called in order, until one does not succeed."""
    node = Managed()
    world.keep(node)
    entities = [Entity(), Entity(), Entity()]
    for entity in entities:
        node.add_managed_entity(entity)
    nothing: Any = 3
    with pytest.raises(TypeError, match=r"^Expected a rclpy.lifecycle.ManagedEntity instance\.$"):
        node.add_managed_entity(nothing)
    node.trigger_configure()
    entities[1].result = FAILURE
    assert node.trigger_activate() is FAILURE
    assert [entity.heard for entity in entities] == [["inactive"], ["inactive"], []]
    entities[1].result = None
    assert node.trigger_activate() is ERROR
    assert f"on_activate() return value of class {Entity} should be" in (capfd.readouterr().err)
    assert node._state_machine.current_state[1] == "unconfigured"


def test_a_method_for_enabled_entities() -> None:
    called: list[object] = []

    class Motor(SimpleManagedEntity):
        @SimpleManagedEntity.when_enabled
        def run(self, speed: int, *, way: str = "") -> str:
            called.append((speed, way))
            return "dropped"

        @SimpleManagedEntity.when_enabled(when_not_enabled=lambda: called.append("off"))
        def stop(self) -> None:
            called.append("stopped")

    motor, state = Motor(), LifecycleState("inactive", 2)
    for _ in range(2):
        motor.run(1, way="left")
        motor.stop()
        motor.on_activate(state)
    assert called == ["off", (1, "left"), "stopped"]
    assert motor.is_activated
    assert motor.on_deactivate(state) is SUCCESS
    assert not motor.is_activated


def test_services(node: Recorder, caller: Caller) -> None:
    state = caller.ask("get_state", "GetState").current_state
    assert (state.id, state.label) == (1, "unconfigured")
    assert caller.change(id=1) and caller.change(label="activate")
    assert caller.change(id=3, label="deactivate")  # the label counts
    assert node.state == "inactive"
    states = caller.ask("get_available_states", "GetAvailableStates").available_states
    assert [(one.id, one.label) for one in states] == node._state_machine.available_states
    for service, expected in (
        ("get_available_transitions", node._state_machine.available_transitions),
        ("get_transition_graph", node._state_machine.transition_graph),
    ):
        found = caller.ask(service, "GetAvailableTransitions").available_transitions
        assert expected == [
            (
                *(one.transition.id, one.transition.label, one.start_state.id, one.start_state.label),
                *(one.goal_state.id, one.goal_state.label),
            )
            for one in found
        ]


def test_services_refuse(node: Recorder, caller: Caller) -> None:
    """An impossible transition, a failure and an exception are answers, and the node continues."""
    for wrong in ({"id": 3}, {"id": 97}, {"id": 255}, {"label": "nonsense"}, {}):
        assert not caller.change(**wrong)
    assert node.called == []
    for result in (FAILURE, ERROR, ValueError("no")):
        node.results["configure"] = result
        assert not caller.change(label="configure")
        assert node.state == "unconfigured"
    node.results.clear()
    assert caller.change(label="configure")


@pytest.mark.parametrize("wrong", [{"id": 1}, {"id": 10}, {"id": 12}, {"label": "transition_success"}])
def test_a_request_during_a_transition_does_not_end_it(
    world: World, capfd: pytest.CaptureFixture[str], wrong: dict[str, Any]
) -> None:
    """The services may be served during the callback, by another thread or a nested spin."""
    answers: list[bool] = []

    class Asked(Recorder):
        def on_configure(self, state: State) -> TransitionCallbackReturn:
            answers.append(outside.change(**wrong))
            return SUCCESS

    node = Asked()
    world.keep(node)
    outside = Caller(world, node)
    assert node.trigger_configure() is SUCCESS
    assert answers == [False]
    assert node.state == "inactive"
    number = wrong.get("id", 10)
    assert f"No transition matching {number} found for current state configuring" in capfd.readouterr().err


def test_events(world: World, node: Recorder) -> None:
    listener = world.node("listener")
    heard: list[Any] = []
    event = message_class("lifecycle_msgs/msg/TransitionEvent")
    listener.create_subscription(event, "/lc/transition_event", heard.append, 10)
    before = node.get_clock().now().nanoseconds
    node.trigger_configure()
    world.spin_until(lambda: len(heard) == 2, listener)
    assert [(one.transition.id, one.transition.label) for one in heard] == [
        *((1, "configure"), (10, "transition_success"))
    ]
    assert [(one.start_state.label, one.goal_state.label) for one in heard] == [
        *(("unconfigured", "configuring"), ("configuring", "inactive"))
    ]
    assert before <= heard[0].timestamp <= heard[1].timestamp <= node.get_clock().now().nanoseconds


def test_alone_it_has_no_services(world: World) -> None:
    node = Recorder(enable_communication_interface=False)
    world.keep(node)
    assert list(node.services) == list(node.publishers) == []
    assert node.trigger_configure() is SUCCESS


def test_destroyed_it_makes_transitions_that_nobody_hears_of(node: Recorder) -> None:
    node.destroy_node()
    assert node.trigger_configure() is SUCCESS
    assert node.trigger_shutdown() is SUCCESS
    assert node.state == "finalized"


def test_whether_it_has_services_is_yes_or_no(world: World) -> None:
    with pytest.raises(TypeError, match="enable_communication_interface must be a bool, not 'yes'"):
        Recorder(enable_communication_interface="yes")
    assert "lc" not in world.node().get_node_names()


def test_a_node_made_of_the_mixin(world: World) -> None:
    class Own(lifecycle.NodeMixin, Node):
        def __init__(self) -> None:
            Node.__init__(self, "own", start_parameter_services=False)
            lifecycle.NodeMixin.__init__(self, callback_group=group)

    group = ReentrantCallbackGroup()
    node = Own()
    world.keep(node)
    assert node.trigger_configure() is SUCCESS
    services = [one for one in node.services if one.srv_name.startswith("/own/")]
    assert {one.service_name: one.callback_group for one in services} == dict.fromkeys(
        (
            *("/own/change_state", "/own/get_state", "/own/get_available_states"),
            *("/own/get_available_transitions", "/own/get_transition_graph"),
        ),
        group,
    )


def test_short_names() -> None:
    assert lifecycle.Node is LifecycleNode
    assert lifecycle.NodeMixin is LifecycleNodeMixin
    assert lifecycle.State is LifecycleState
    assert not {"Node", "NodeMixin", "State", "Publisher"} & set(lifecycle.__all__)
