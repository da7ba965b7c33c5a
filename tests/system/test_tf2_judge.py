"""The same operations here and in ROS 1's tf2 (Debian's python3-tf2), with the same rules in C++."""

import json
import subprocess
from pathlib import Path
from random import Random
from typing import Any

import pytest

from bus_tf2.tf2_py import BufferCore, TransformException
from tf2_world import at, transform

PYTHON = "/usr/bin/python3"
JUDGE = Path(__file__).parents[1] / "tf2_judge.py"
SECOND = 1_000_000_000


def judged(deeds: list[list[Any]]) -> list[Any]:
    if not Path(PYTHON).exists():
        pytest.skip(f"no {PYTHON}")
    probe = subprocess.run([PYTHON, "-c", "import tf2_py, genpy"], capture_output=True, timeout=60)
    if probe.returncode:
        pytest.skip("no tf2 of ROS 1 to compare with (Debian: apt install python3-tf2)")
    words = [PYTHON, str(JUDGE)]
    run = subprocess.run(
        words, input=json.dumps(deeds), capture_output=True, text=True, timeout=60, check=True
    )
    return list(json.loads(run.stdout))


def ours(deeds: list[list[Any]]) -> list[Any]:
    answers = []
    for what, *deed in deeds:
        if what == "begin":
            buffer = BufferCore()
        elif what == "tell":
            parent, child, time_ns, moved, turned, is_static = deed
            put = buffer.set_transform_static if is_static else buffer.set_transform
            put(transform(parent, child, time_ns / SECOND, tuple(moved), tuple(turned)), "me")
        else:
            answers.append(ask(buffer, *deed))
    return answers


def ask(buffer: BufferCore, target: str, source: str, time_ns: int) -> Any:
    try:
        found = buffer.lookup_transform_core(target, source, at(time_ns / SECOND))
    except TransformException as error:
        return type(error).__name__
    moved, turned, stamp = found.transform.translation, found.transform.rotation, found.header.stamp
    place = [moved.x, moved.y, moved.z, turned.x, turned.y, turned.z, turned.w]
    return [*place, stamp.sec * SECOND + stamp.nanosec]


def story(random: Random) -> list[list[Any]]:
    """Frames that move within ten seconds, at different times, and change parents; then queries for them."""
    names = list("abcdefgh")
    deeds: list[list[Any]] = [["begin"]]
    static = set(random.sample(names[1:], 3))
    for child in names[1:]:
        parents = [name for name in names if name < child]
        times = [0] if child in static else sorted(random.sample(range(1, 90), random.randint(1, 12)))
        parent = random.choice(parents)
        for time in times:
            if random.random() < 0.1:
                parent = random.choice(parents)
            moved = [random.uniform(-3, 3) for _ in range(3)]
            deeds.append(["tell", parent, child, time * SECOND // 10, moved, turn(random), child in static])
    random.shuffle(names)
    for _ in range(60):
        target, source = random.choice([*names, "nobody", ""]), random.choice(names)
        deeds.append(["ask", target, source, random.choice((0, 0, random.randint(1, 95) * SECOND // 10))])
    return deeds


def turn(random: Random) -> list[float]:
    parts = [random.gauss(0, 1) for _ in range(4)]
    length = sum(part * part for part in parts) ** 0.5
    return [part / length for part in parts]


def test_same_answers() -> None:
    deeds = [deed for seed in range(40) for deed in story(Random(seed))]
    questions = [deed for deed in deeds if deed[0] == "ask"]
    answered = 0
    for deed, theirs, mine in zip(questions, judged(deeds), ours(deeds), strict=True):
        if isinstance(theirs, str):
            assert mine == theirs, deed
        else:
            answered += deed[1] != deed[2]
            sign = 1 if sum(a * b for a, b in zip(theirs[3:7], mine[3:7], strict=True)) > 0 else -1
            turned = [sign * part for part in mine[3:7]]
            assert [*mine[:3], *turned] == pytest.approx(theirs[:7], abs=1e-9), deed
            assert mine[7] == theirs[7], deed
    assert answered > 500
