"""Bridges: topics and services of this bus on other machines, and on ROS 2.

A bridge is a client like any other, in a process of its own. What it mirrors, which ways it makes and what it
counts stands here; the engines below (`zenoh`, `dds`) know only their wire.
"""
