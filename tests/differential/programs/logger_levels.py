"""Log levels: of loggers, by the services of enable_logger_service, and of the root logger."""

import rclpy
import rclpy.logging
from rcl_interfaces.msg import LoggerLevel
from rcl_interfaces.srv import GetLoggerLevels, SetLoggerLevels
from rclpy.logging import LoggingSeverity
from show import attempt

rclpy.init()
node = rclpy.create_node("logged", namespace="/space", enable_logger_service=True)
other = rclpy.create_node("asking", namespace="/space")
print(sorted(one for one in node.get_service_names_and_types() if "logger" in one[0]))
getter = other.create_client(GetLoggerLevels, "/space/logged/get_logger_levels")
setter = other.create_client(SetLoggerLevels, "/space/logged/set_logger_levels")
print(getter.wait_for_service(5.0), setter.wait_for_service(5.0))
executor = rclpy.executors.SingleThreadedExecutor()
executor.add_node(node)
executor.add_node(other)


def ask(client, request):
    future = client.call_async(request)
    executor.spin_until_future_complete(future, timeout_sec=5.0)
    return future.result()


def levels(*names):
    return [(one.name, one.level) for one in ask(getter, GetLoggerLevels.Request(names=names)).levels]


def set_levels(*pairs):
    wanted = [LoggerLevel(name=name, level=level) for name, level in pairs]
    found = ask(setter, SetLoggerLevels.Request(levels=wanted)).results
    return [(one.successful, one.reason) for one in found]


print(levels("a", "space.logged", "", "a.b"))
print(set_levels(("a", 10), ("space.logged", 40)))
print(levels("a", "space.logged", "", "a.b"))
print(rclpy.logging.get_logger_level("a"), rclpy.logging.get_logger_effective_level("a.b"))
print(node.get_logger().get_effective_level())
print(set_levels(("a", 7), ("a", 20), ("b", 0), ("a", 50), ("a", 60)))
print(levels("a", "b"))
print(set_levels(("", 30)))
print(levels("", "fresh"))
print(set_levels(), levels())
rclpy.logging._root_logger.set_level(LoggingSeverity.INFO)
print(rclpy.logging.get_logger_effective_level("fresh"), rclpy.logging.get_logger_effective_level(""))
attempt("no severity", rclpy.logging.set_logger_level, "a", 7)
attempt("a text", rclpy.logging.set_logger_level, "a", "DEBUG")
attempt("severity", rclpy.logging.get_logging_severity_from_string, "nonsense")
print(rclpy.logging.get_logging_severity_from_string("WARN"))
attempt("logged", rclpy.logging._root_logger.log, "text", LoggingSeverity.DEBUG)
attempt("logger", rclpy.logging.get_logger, "")
attempt("child", node.get_logger().get_child, "")
print(node.get_logger().get_child("arm").name, rclpy.logging._root_logger.get_child("x").name)
rclpy.shutdown()
