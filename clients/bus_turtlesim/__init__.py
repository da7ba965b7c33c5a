"""turtlesim, ROS 2's first robot, and the programs of its package.

    `turtlesim_node.py` --+-- `turtle_endpoints.py`  topics, services and action of one turtle
                          +-- `world.py` --> `canvas.py`  turtles and what they draw; pure
                          +-- `page.py` --> `frames.py`   the page in a browser
    programs: `turtle_teleop_key.py` (`keys.py`), `draw_square.py`, `mimic.py`

Invariants:

- `world.py`, `canvas.py`, `frames.py` and `keys.py` know no bus and no page. import-linter checks this.
- Names, units, speeds and texts are the same as in ROS 2's turtlesim, so its tutorials fit.
- The page has its own thread. The node sends to it, and nothing comes back: a browser changes nothing.

Read first: `world.py`. Tests: `tests/unit/bus_turtlesim/`, `tests/system/test_turtlesim.py`,
`tests/system/test_turtlesim_page.py`.
"""
