"""The programs of tf2: `bus run tf2_ros static_transform_publisher`, and so on; see `bus_ros.packages`."""
