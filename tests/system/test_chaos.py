"""Random faults on a bus (`tests/chaos`): processes killed, stopped, cut off or starved; kept promises.

BUSD_CHAOS_SEED repeats the faults of one run.
"""

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bus import shm
from conftest import WAIT_S
from neighbours import wait_until

SECONDS = 20
_PATHS = [str(Path(__file__).parents[1]), os.environ.get("PYTHONPATH", "")]
ENVIRONMENT = os.environ | {"PYTHONPATH": os.pathsep.join(_PATHS).rstrip(os.pathsep)}


@pytest.mark.nightly
@pytest.mark.timeout(280)
@pytest.mark.skipif(not shm.is_available(), reason="without shared memory there is one route only")
def test_what_was_promised_holds_in_storms(tmp_path: Path) -> None:
    command = [sys.executable, "-m", "chaos", "--seconds", str(SECONDS), "--folder", str(tmp_path)]
    if seed := os.environ.get("BUSD_CHAOS_SEED"):
        command += ["--seed", seed]
    done = subprocess.run(
        command,
        capture_output=True,
        text=True,
        env=ENVIRONMENT,
        timeout=260,
        check=False,
    )
    print(done.stdout)
    assert not done.returncode, done.stdout + done.stderr
    assert "Traceback" not in done.stderr


def test_ctrl_c_leaves_nothing(tmp_path: Path) -> None:
    place, said = tmp_path / "place", tmp_path / "said"
    place.mkdir()
    with said.open("w") as errors:  # a file: children would keep a pipe open if this fails
        run = subprocess.Popen(
            [sys.executable, "-m", "chaos"],
            stdout=subprocess.DEVNULL,
            stderr=errors,
            env=ENVIRONMENT | {"TMPDIR": str(place)},
        )
    try:
        wait_until(lambda: any(place.glob("*/zygote.log")))
        run.send_signal(signal.SIGINT)
        run.wait(WAIT_S)
    finally:
        run.kill()
        run.wait()
    assert (run.returncode, said.read_text()) == (130, "interrupted\n")
    assert list(place.iterdir()) == []
