"""Timers: when they are ready, cancel, reset, and errors of a destroyed one."""

import rclpy
from show import attempt, until

rclpy.init()
node = rclpy.create_node("timers")
calls = []
timer = node.create_timer(0.02, lambda: calls.append(None))
print(timer.timer_period_ns, timer.is_canceled(), timer.is_ready())
until(lambda: calls, lambda: rclpy.spin_once(node, timeout_sec=0.1))
print(len(calls), 0 <= timer.time_since_last_call() < 10**9)
timer.cancel()
print(timer.is_canceled(), timer.is_ready(), timer.time_until_next_call())
timer.timer_period_ns = 10**9
timer.reset()
print(timer.is_canceled(), timer.timer_period_ns, 0 < timer.time_until_next_call() <= 10**9)
still = node.create_timer(0.01, print, autostart=False)
print(still.is_canceled(), list(node.timers) == [timer, still])
attempt("destroy", node.destroy_timer, timer)
attempt("again", node.destroy_timer, timer)
attempt("cancel", timer.cancel)
attempt("below zero", node.create_timer, -1.0, print)
attempt("no function", node.create_timer, 1.0, 5)
attempt("no number", node.create_timer, "1s", print)
attempt("rate", node.create_rate, 0)
node.destroy_node()
rclpy.shutdown()
