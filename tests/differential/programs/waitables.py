"""A program's own waitables, and events and actions in wait sets."""

import rclpy
from rclpy.action import ActionClient, ActionServer
from rclpy.callback_groups import MutuallyExclusiveCallbackGroup
from rclpy.event_handler import PublisherEventCallbacks, QoSPublisherEventType, QoSSubscriptionEventType
from rclpy.executors import SingleThreadedExecutor
from rclpy.impl.implementation_singleton import rclpy_implementation as _rclpy
from rclpy.qos import QoSProfile
from rclpy.task import Future
from rclpy.type_support import check_for_type_support
from rclpy.waitable import NumberOfEntities, Waitable
from show import attempt, until
from test_msgs.action import Fibonacci
from test_msgs.msg import BasicTypes
from test_msgs.srv import BasicTypes as BasicService

PROFILE = QoSProfile(depth=10).get_c_qos_profile()


class Everything(Waitable):
    def __init__(self, node):
        super().__init__(MutuallyExclusiveCallbackGroup())
        self.guard = _rclpy.GuardCondition(node.context.handle)
        self.timer = _rclpy.Timer(node.get_clock().handle, node.context.handle, 20_000_000, True)
        self.subscription = _rclpy.Subscription(node.handle, BasicTypes, "topic", PROFILE)
        self.client = _rclpy.Client(node.handle, BasicService, "service", PROFILE)
        self.service = _rclpy.Service(node.handle, BasicService, "service", PROFILE)
        self.kinds = ("guard_condition", "subscription", "client", "service")
        self.found = []
        self.future = Future()
        self.is_timed = False

    def entities(self):
        return (self.guard, self.subscription, self.client, self.service)

    def add_to_wait_set(self, wait_set):
        self.indices = [
            getattr(wait_set, f"add_{kind}")(one)
            for kind, one in zip(self.kinds, self.entities(), strict=True)
        ]
        self.timer_index = wait_set.add_timer(self.timer)

    def is_ready(self, wait_set):
        self.ready = [
            kind
            for kind, index in zip(self.kinds, self.indices, strict=True)
            if wait_set.is_ready(kind, index)
        ]
        if wait_set.is_ready("timer", self.timer_index) and self.timer.is_timer_ready():
            self.ready.append("timer")
        return bool(self.ready)

    def take_data(self):
        taken = {}
        for kind in self.ready:
            if kind == "timer":
                self.timer.call_timer()
                taken[kind] = "called"
            elif kind == "subscription":
                message, info = self.subscription.take_message(BasicTypes, False)
                taken[kind] = (message.int64_value, sorted(info))
            elif kind == "client":
                header, response = self.client.take_response(BasicService.Response)
                taken[kind] = (header.request_id.sequence_number, response.int64_value)
            elif kind == "service":
                request, header = self.service.service_take_request(BasicService.Request)
                response = BasicService.Response(int64_value=2 * request.int64_value)
                self.service.service_send_response(response, header.request_id)
                taken[kind] = request.int64_value
            else:
                taken[kind] = "triggered"
        return taken

    async def execute(self, taken):
        for kind, what in taken.items():
            if kind == "timer":
                self.is_timed = True
            else:
                self.found.append((kind, what))

    def get_num_entities(self):
        return NumberOfEntities(num_subs=1, num_gcs=1, num_timers=1, num_clients=1, num_services=1)


print(NumberOfEntities(1, 2, 3, 4, 5, 6), NumberOfEntities(1, num_events=2) + NumberOfEntities(2, 1))
plain = Waitable(MutuallyExclusiveCallbackGroup())
attempt("is_ready", plain.is_ready, None)
attempt("take_data", plain.take_data)
attempt("get_num_entities", plain.get_num_entities)
attempt("add_to_wait_set", plain.add_to_wait_set, None)

for used in (BasicTypes, BasicService):
    check_for_type_support(used)
rclpy.init()
node = rclpy.create_node("waiting")
waitable = Everything(node)
before = len(list(node.waitables))
node.add_waitable(waitable)
print(len(list(node.waitables)) - before, waitable in node.waitables)
executor = SingleThreadedExecutor()
executor.add_node(node)


def found():
    until(lambda: waitable.found, lambda: executor.spin_once(timeout_sec=0.1))
    one, waitable.found = waitable.found, []
    return one


waitable.guard.trigger_guard_condition()
print(found())
publisher = node.create_publisher(BasicTypes, "topic", 10)
until(lambda: publisher.get_subscription_count())
publisher.publish(BasicTypes(int64_value=5))
print(found())
until(waitable.client.service_server_is_available)
print(waitable.client.send_request(BasicService.Request(int64_value=21)))
print(found())
print(found())
until(lambda: waitable.is_timed, lambda: executor.spin_once(timeout_sec=0.1))
print(waitable.is_timed, waitable.timer.get_timer_period(), waitable.timer.is_timer_canceled())
waitable.timer.cancel_timer()
print(waitable.timer.is_timer_canceled())
node.remove_waitable(waitable)
print(waitable in node.waitables)
wait_set = _rclpy.WaitSet(0, 1, 0, 0, 0, 0, node.context.handle)
index = wait_set.add_guard_condition(waitable.guard)
wait_set.wait(1_000_000)
print(index, wait_set.is_ready("guard_condition", index))
waitable.guard.trigger_guard_condition()
wait_set.clear_entities()
wait_set.add_guard_condition(waitable.guard)
wait_set.wait(-1)
print(
    wait_set.is_ready("guard_condition", 0),
    wait_set.get_ready_entities("guard_condition") == [waitable.guard.pointer],
)

talker = rclpy.create_node("talker")
matches = []
sending = talker.create_publisher(
    BasicTypes, "events", 10, event_callbacks=PublisherEventCallbacks(matched=matches.append)
)
with sending.handle:
    event = _rclpy.EventHandle(sending.handle, QoSPublisherEventType.RCL_PUBLISHER_MATCHED)
deadline = _rclpy.EventHandle(
    sending.handle, QoSPublisherEventType.RCL_PUBLISHER_OFFERED_DEADLINE_MISSED
).take_event()
print(deadline.total_count, deadline.total_count_change)


def counts(one):
    return one.total_count, one.total_count_change, one.current_count, one.current_count_change


print(counts(event.take_event()))
listening = talker.create_subscription(BasicTypes, "events", lambda message: None, 10)
wait_set = _rclpy.WaitSet(0, 0, 0, 0, 0, 1, talker.context.handle)
index = wait_set.add_event(event)
wait_set.wait(5_000_000_000)
print(index, wait_set.is_ready("event", index), counts(event.take_event()), counts(event.take_event()))
wait_set.clear_entities()
index = wait_set.add_event(event)
wait_set.wait(1_000_000)
print(wait_set.is_ready("event", index))
for parent, kind in (
    (sending, QoSSubscriptionEventType.RCL_SUBSCRIPTION_MATCHED),
    (listening, QoSPublisherEventType.RCL_PUBLISHER_MATCHED),
):
    try:
        _rclpy.EventHandle(parent.handle, kind)
    except TypeError:
        print("TypeError")

handler = next(
    one for one in sending.event_handlers if one.event_type == QoSPublisherEventType.RCL_PUBLISHER_MATCHED
)
print(handler.get_num_entities())
wait_set = _rclpy.WaitSet(0, 0, 0, 0, 0, 1, talker.context.handle)
handler.add_to_wait_set(wait_set)
also = talker.create_subscription(BasicTypes, "events", lambda message: None, 10)
wait_set.wait(5_000_000_000)
print(handler.is_ready(wait_set))


def complete(coroutine):
    try:
        coroutine.send(None)
    except StopIteration:
        return
    print("it waits")


complete(handler.execute(handler.take_data()))
print([(one.total_count, one.current_count) for one in matches])

acting = rclpy.create_node("acting")


def fulfil(goal_handle):
    goal_handle.succeed()
    return Fibonacci.Result(sequence=[goal_handle.request.order])


server = ActionServer(acting, Fibonacci, "fibonacci", fulfil)
client = ActionClient(talker, Fibonacci, "fibonacci")
print(isinstance(client, Waitable), isinstance(server, Waitable))
print(client in talker.waitables, server in acting.waitables, client in acting.waitables)
serving = SingleThreadedExecutor()
serving.add_node(acting)
print(client.wait_for_server(timeout_sec=10))


def look():
    wait_set = _rclpy.WaitSet(2, 0, 0, 3, 0, 0, talker.context.handle)
    serving.spin_once(timeout_sec=0.01)
    client.add_to_wait_set(wait_set)
    wait_set.wait(10_000_000)
    if client.is_ready(wait_set):
        complete(client.execute(client.take_data()))


sent = client.send_goal_async(Fibonacci.Goal(order=3))
until(sent.done, look)
print(sent.result().accepted)
result = sent.result().get_result_async()
until(result.done, look)
print(result.result().status, list(result.result().result.sequence))
client.destroy()
print(client in talker.waitables)
server.destroy()
rclpy.shutdown()
