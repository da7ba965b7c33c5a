"""A small Nav2: its lifecycle nodes, actions and services, without a robot.

A goal with a negative x is rejected; the planner 'broken' fails; the behaviour tree 'endless' runs until it is
cancelled.
"""
import threading

import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from nav2_msgs.action import ComputePathToPose, FollowPath, FollowWaypoints, NavigateToPose, Spin
from nav2_msgs.srv import ClearEntireCostmap, GetCostmap, LoadMap, ManageLifecycleNodes
from rclpy.action import ActionServer, CancelResponse, GoalResponse
from rclpy.callback_groups import ReentrantCallbackGroup
from rclpy.executors import ExternalShutdownException, MultiThreadedExecutor
from rclpy.lifecycle import LifecycleNode, TransitionCallbackReturn
from rclpy.qos import QoSDurabilityPolicy, QoSProfile


class Localizer(LifecycleNode):
    def __init__(self):
        super().__init__('amcl')
        latched = QoSProfile(depth=1, durability=QoSDurabilityPolicy.TRANSIENT_LOCAL)
        self.poses = self.create_publisher(PoseWithCovarianceStamped, 'amcl_pose', latched)
        self.create_subscription(PoseWithCovarianceStamped, 'initialpose', self.poses.publish, 10)


class Navigator(LifecycleNode):
    def __init__(self):
        super().__init__('bt_navigator')
        self.cancelled = threading.Event()
        for cls, name, execute in (
            (NavigateToPose, 'navigate_to_pose', self.navigate),
            (FollowWaypoints, 'follow_waypoints', self.follow_waypoints),
            (FollowPath, 'follow_path', self.follow_path),
            (ComputePathToPose, 'compute_path_to_pose', self.plan),
            (Spin, 'spin', self.turn),
        ):
            ActionServer(
                self, cls, name, execute, callback_group=ReentrantCallbackGroup(),
                goal_callback=self.on_goal, cancel_callback=self.on_cancel,
            )
        for cls, name in (
            (ClearEntireCostmap, 'local_costmap/clear_entirely_local_costmap'),
            (ClearEntireCostmap, 'global_costmap/clear_entirely_global_costmap'),
            (GetCostmap, 'global_costmap/get_costmap'),
            (LoadMap, 'map_server/load_map'),
            (ManageLifecycleNodes, 'lifecycle_manager/manage_nodes'),
        ):
            self.create_service(cls, name, lambda request, reply, name=name: self.serve(name, request, reply))

    def on_goal(self, goal):
        rejected = isinstance(goal, NavigateToPose.Goal) and goal.pose.pose.position.x < 0
        return GoalResponse.REJECT if rejected else GoalResponse.ACCEPT

    def on_cancel(self, handle):
        self.cancelled.set()
        return CancelResponse.ACCEPT

    def navigate(self, handle):
        for remaining in (2.0, 1.0, 0.0):
            handle.publish_feedback(NavigateToPose.Feedback(distance_remaining=remaining))
        if handle.request.behavior_tree == 'endless':
            self.cancelled.wait()
            handle.canceled()
        else:
            handle.succeed()
        return NavigateToPose.Result()

    def follow_waypoints(self, handle):
        for number, _ in enumerate(handle.request.poses):
            handle.publish_feedback(FollowWaypoints.Feedback(current_waypoint=number))
        handle.succeed()
        return FollowWaypoints.Result()

    def follow_path(self, handle):
        handle.abort()
        return FollowPath.Result(error_code=FollowPath.Result.INVALID_PATH, error_msg='no path')

    def plan(self, handle):
        result = ComputePathToPose.Result()
        if handle.request.planner_id == 'broken':
            handle.abort()
            result.error_code = result.INVALID_PLANNER
        else:
            handle.succeed()
            result.path.poses = [handle.request.start, handle.request.goal]
        return result

    def turn(self, handle):
        handle.publish_feedback(Spin.Feedback(angular_distance_traveled=handle.request.target_yaw))
        handle.succeed()
        return Spin.Result()

    def serve(self, name, request, reply):
        print(name, flush=True)
        if name.endswith('get_costmap'):
            reply.map.metadata.size_x, reply.map.metadata.size_y = 2, 1
            reply.map.data = [0, 254]
        elif name.endswith('load_map'):
            reply.result = LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST
        elif name.endswith('manage_nodes'):
            reply.success = request.command == ManageLifecycleNodes.Request.SHUTDOWN
        return reply


rclpy.init()
executor = MultiThreadedExecutor(3)
for node in (Localizer(), Navigator()):
    assert node.trigger_configure() == node.trigger_activate() == TransitionCallbackReturn.SUCCESS
    executor.add_node(node)
print('ready', flush=True)
try:
    executor.spin()
except ExternalShutdownException:
    pass
