"""Programs written for ROS 2, on busd: `rclpy`, classes made of definitions, and how they are started.

Beside these stand the small libraries that nodes import, a folder each. `import_hook` has the names by which
programs import all of them; nothing is imported from here itself.
"""
