"""`nav2_common`, as far as Nav2's launch files import it: `nav2_common.launch`.

One module of substitutions. Names, arguments and results are Nav2's.

Read first: `launch.py`. Tests: `tests/unit/bus_launch/nav2_common/`.
"""
