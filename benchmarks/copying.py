"""The speed at which this machine copies memory: the limit for every system that copies bytes."""

from benchmarks.adapters.c_program import path_of
from benchmarks.cases import Figures
from benchmarks.harness import START_S, Group

NAME = "C, memcpy"


def measure_copying(size: int, count: int) -> Figures:
    """`count` copies of `size` bytes by memcpy, in one process. Raises Failure if it does not end."""
    with Group() as group:
        program = group.start(NAME, str(path_of("copying")), str(size), str(count))
        seconds = group.expect(program, "copied", within_s=START_S)["ns"] / 1e9
    return {"per_s": count / seconds, "bytes_per_s": count * size / seconds}
