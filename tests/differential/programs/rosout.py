"""Messages of a node's loggers and their children on /rosout, and the filters of a log."""

import rclpy
import rclpy.logging
from rcl_interfaces.msg import Log
from rclpy.qos import DurabilityPolicy, QoSProfile
from show import attempt, until

rclpy.init()
node = rclpy.create_node("logging", namespace="/space")
quiet = rclpy.create_node("quiet", enable_rosout=False)
heard = []
profile = QoSProfile(depth=1000, durability=DurabilityPolicy.TRANSIENT_LOCAL)
subscription = quiet.create_subscription(Log, "/rosout", heard.append, profile)
until(lambda: subscription.get_publisher_count() == 1)
print(subscription.get_publisher_count())
logger = node.get_logger()
child = logger.get_child("arm")
logger.info("from the node")
child.warning("from the child")
child.get_child("hand").error("from its child")
logger.debug("too low")
quiet.get_logger().info("from a quiet node")
rclpy.logging.get_logger("free").info("from no node")
logger.fatal("the end")
until(lambda: heard and heard[-1].msg == "the end", lambda: rclpy.spin_once(quiet, timeout_sec=0.1))
for one in heard:
    print(one.level, one.name, one.msg, one.file.rpartition("/")[2], one.function, one.line > 0)
for index in range(3):
    print(index, logger.info("once", once=True), logger.info("skipped", skip_first=True))
    print(logger.info("throttled", throttle_duration_sec=10.0), logger.debug("low"))
attempt("no filter", logger.info, "text", twice=True)
attempt("no duration", logger.info, "text", throttle_time_source_type="RCUTILS_STEADY_TIME")
for severity in (10, 20):
    attempt("two severities", logger.log, "text", severity)
for keywords in ({"once": True}, {"skip_first": True}):
    attempt("two filters", lambda keywords=keywords: logger.info("text", **keywords))
print(logger.name, child.name, logger.is_enabled_for(10), logger.get_effective_level())
logger.set_level(rclpy.logging.LoggingSeverity.ERROR)
print(child.get_effective_level(), child.is_enabled_for(30), logger.warning("low"))
rclpy.shutdown()
