"""Commands a robot with Nav2's actions, services and lifecycle, in the way of nav2_simple_commander."""
import time

import rclpy
from action_msgs.msg import GoalStatus
from geometry_msgs.msg import PoseStamped, PoseWithCovarianceStamped
from lifecycle_msgs.srv import GetState
from nav2_msgs.action import ComputePathToPose, FollowPath, FollowWaypoints, NavigateToPose, Spin
from nav2_msgs.srv import ClearEntireCostmap, GetCostmap, LoadMap, ManageLifecycleNodes
from rclpy.action import ActionClient
from rclpy.node import Node
from rclpy.qos import QoSDurabilityPolicy, QoSHistoryPolicy, QoSProfile, QoSReliabilityPolicy

NAMES = {
    getattr(GoalStatus, name): name.lower()[7:]
    for name in ('STATUS_SUCCEEDED', 'STATUS_CANCELED', 'STATUS_ABORTED')
}


class Commander(Node):
    def __init__(self):
        super().__init__(node_name='commander', namespace='')
        self.goal_handle = self.result_future = self.feedback = self.status = None
        self.is_localized = False
        self.action_clients = {
            cls: ActionClient(self, cls, name)
            for cls, name in (
                (NavigateToPose, 'navigate_to_pose'),
                (FollowWaypoints, 'follow_waypoints'),
                (FollowPath, 'follow_path'),
                (ComputePathToPose, 'compute_path_to_pose'),
                (Spin, 'spin'),
            )
        }
        latched = QoSProfile(
            durability=QoSDurabilityPolicy.TRANSIENT_LOCAL,
            reliability=QoSReliabilityPolicy.RELIABLE,
            history=QoSHistoryPolicy.KEEP_LAST,
            depth=1,
        )
        self.create_subscription(PoseWithCovarianceStamped, 'amcl_pose', self.on_pose, latched)
        self.initial_poses = self.create_publisher(PoseWithCovarianceStamped, 'initialpose', 10)

    def destroy_node(self):
        for client in self.action_clients.values():
            client.destroy()
        super().destroy_node()

    def on_pose(self, message):
        self.is_localized = True

    def on_feedback(self, message):
        self.feedback = message.feedback

    def call(self, cls, name, **fields):
        client = self.create_client(cls, name)
        while not client.wait_for_service(timeout_sec=1.0):
            self.get_logger().info(f'{name} is not available, waiting ...')
        future = client.call_async(cls.Request(**fields))
        rclpy.spin_until_future_complete(self, future)
        self.destroy_client(client)
        return future.result()

    def wait_until_active(self, name):
        while self.call(GetState, f'{name}/get_state').current_state.label != 'active':
            time.sleep(0.01)

    def wait_for_pose(self):
        while not self.is_localized:
            self.initial_poses.publish(PoseWithCovarianceStamped())
            rclpy.spin_once(self, timeout_sec=1.0)

    def send(self, cls, **fields):
        client = self.action_clients[cls]
        while not client.wait_for_server(timeout_sec=1.0):
            self.get_logger().info('the server is not available, waiting ...')
        self.feedback = None
        future = client.send_goal_async(cls.Goal(**fields), self.on_feedback)
        rclpy.spin_until_future_complete(self, future)
        self.goal_handle = future.result()
        if not self.goal_handle.accepted:
            return False
        self.result_future = self.goal_handle.get_result_async()
        return True

    def is_complete(self):
        rclpy.spin_until_future_complete(self, self.result_future, timeout_sec=0.1)
        if not self.result_future.result():
            return False
        self.status = NAMES[self.result_future.result().status]
        return True

    def run(self, cls, **fields):
        assert self.send(cls, **fields)
        while not self.is_complete():
            pass
        return self.result_future.result().result

    def hear(self, field, value):
        while getattr(self.feedback, field, None) != value:  # it may come later than the result
            rclpy.spin_once(self)
        return value

    def cancel(self):
        future = self.goal_handle.cancel_goal_async()
        rclpy.spin_until_future_complete(self, future)
        return len(future.result().goals_canceling)


def pose(x):
    made = PoseStamped()
    made.header.frame_id = 'map'
    made.header.stamp = commander.get_clock().now().to_msg()
    made.pose.position.x = x
    return made


rclpy.init()
commander = Commander()
commander.wait_until_active('amcl')
commander.wait_for_pose()
commander.wait_until_active('bt_navigator')
print('active')

commander.run(NavigateToPose, pose=pose(2.0))
print('to a pose:', commander.status, commander.hear('distance_remaining', 0.0))
print('to a pose outside:', commander.send(NavigateToPose, pose=pose(-2.0)))

assert commander.send(NavigateToPose, pose=pose(2.0), behavior_tree='endless')
print('endless:', commander.is_complete(), commander.cancel())
while not commander.is_complete():
    pass
print('endless:', commander.status)

commander.run(FollowWaypoints, poses=[pose(1.0), pose(2.0), pose(3.0)])
print('waypoints:', commander.status, commander.hear('current_waypoint', 2))
path = commander.run(ComputePathToPose, start=pose(0.0), goal=pose(3.0), use_start=True).path
print('path:', commander.status, [one.pose.position.x for one in path.poses])
result = commander.run(ComputePathToPose, start=pose(0.0), goal=pose(3.0), planner_id='broken')
print('no path:', commander.status, result.error_code == ComputePathToPose.Result.INVALID_PLANNER)
result = commander.run(FollowPath, path=path)
print('follow a path:', commander.status, result.error_code, result.error_msg)
commander.run(Spin, target_yaw=1.5)
print('turn:', commander.status, commander.hear('angular_distance_traveled', 1.5))

commander.call(ClearEntireCostmap, 'local_costmap/clear_entirely_local_costmap')
commander.call(ClearEntireCostmap, 'global_costmap/clear_entirely_global_costmap')
costmap = commander.call(GetCostmap, 'global_costmap/get_costmap').map
print('costmap:', costmap.metadata.size_x, list(costmap.data))
result = commander.call(LoadMap, 'map_server/load_map', map_url='/none.yaml').result
print('map:', result == LoadMap.Response.RESULT_MAP_DOES_NOT_EXIST)
for name, types in commander.get_service_names_and_types():
    if types[0] == 'nav2_msgs/srv/ManageLifecycleNodes':
        request = ManageLifecycleNodes.Request
        print(name, commander.call(ManageLifecycleNodes, name, command=request.SHUTDOWN).success)

commander.destroy_node()
rclpy.shutdown()
