"""Bags: recordings of topics, in files that every tool of ROS 2 opens."""
