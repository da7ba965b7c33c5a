"""A program that commands Nav2, and a small Nav2: actions, services and lifecycle, in two processes."""

from pathlib import Path

import pytest

from programs import on_one_loop, running

PROGRAMS = Path(__file__).parents[1] / "lesson" / "nav2"
SAID = """\
active
to a pose: succeeded 0.0
to a pose outside: False
endless: False 1
endless: canceled
waypoints: succeeded 2
path: succeeded [0.0, 3.0]
no path: aborted True
follow a path: aborted 103 no path
turn: succeeded 1.5
costmap: 2 [0, 254]
map: True
/lifecycle_manager/manage_nodes True
"""
SERVED = [
    "local_costmap/clear_entirely_local_costmap",
    "global_costmap/clear_entirely_global_costmap",
    "global_costmap/get_costmap",
    "map_server/load_map",
    "lifecycle_manager/manage_nodes",
]


@pytest.mark.usefixtures("daemon", "route")
@on_one_loop
async def test_a_commander_and_its_navigation(tmp_path: Path) -> None:
    async with running(tmp_path, "-m", "bus_cli", "run", PROGRAMS / "navigation.py") as navigation:
        await navigation.line("ready")
        async with running(tmp_path, "-m", "bus_cli", "run", PROGRAMS / "commander.py") as commander:
            assert await commander.end() == 0, commander.lines
        navigation.process.terminate()
        assert await navigation.end() == 0, navigation.lines
    assert commander.lines == SAID.splitlines()
    assert navigation.lines == ["ready", *SERVED]
