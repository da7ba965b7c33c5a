"""Verbs of `bus multicast`: one UDP datagram to a multicast group, and one from it.

`udp.py` has the sockets, also for `bus doctor hello`. busd itself does not use the network. These verbs help
to find out why a bridge, or ROS 2 behind it, does not see another machine.

Read first: `udp.py`. Tests: `tests/system/test_cli_multicast.py`.
"""
