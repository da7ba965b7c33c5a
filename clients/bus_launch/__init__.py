"""Launch files: what they import as `launch`, `launch_ros`, `launch_xml`, `launch_yaml` and `launch_testing`.

The modules here have the names of ROS 2's. `bus launch` runs launch files with them, or with the genuine ones
where those can be imported: `bus_ros.import_hook` decides. `inheritance.prepare` is for the program `bus`.
"""
