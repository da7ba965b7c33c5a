"""bus.shm.headroom: free memory of memory cgroups of both versions and of the machine, in a made-up /proc."""

import errno
import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from bus.shm import has_core, headroom, segments
from bus.shm.headroom import Room
from rows import for_each

MiB = 1 << 20
UNLIMITED = 9223372036854771712
"""The value of cgroups of version 1 for "no limit"."""


class Tree:
    """A made-up machine. It has 8 GiB, of which 4 GiB are free, until a test changes that."""

    def __init__(self, folder: Path) -> None:
        self.proc = folder / "proc"
        self.top = folder / "sys" / "a cgroup"
        self._mounts: list[str] = []
        (self.proc / "self").mkdir(parents=True)
        self.machine(8192, 4096)
        self.is_in("0::/")
        self.mounts()

    def machine(self, total_mib: int, available_mib: int) -> None:
        lines = f"MemTotal: {total_mib << 10} kB\nMemFree: 1 kB\nMemAvailable: {available_mib << 10} kB\n"
        (self.proc / "meminfo").write_text(lines + "HugePages_Total: 0\nOdd\n")

    def is_in(self, *lines: str, process: str = "self") -> None:
        (self.proc / process).mkdir(exist_ok=True)
        (self.proc / process / "cgroup").write_text("\n".join(lines) + "\n")
        headroom._places.cache_clear()

    def mounts(self, *more: str) -> None:
        (self.proc / "self" / "mountinfo").write_text(
            "\n".join(["21 1 0:20 / /proc rw shared:5 - proc proc rw", *more]) + "\n"
        )
        headroom._places.cache_clear()

    def mount(self, kind: str, root: str = "/", options: str = "rw") -> str:
        place = str(self.top).replace(" ", "\\040")
        return f"30 21 0:26 {root} {place} rw,nosuid shared:9 - {kind} cgroup {options}"

    def write(self, path: str, **files: object) -> None:
        folder = self.top / path
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            (folder / name.replace("_", ".", 1)).write_text(f"{text}\n")

    def second(self, path: str, limit: object, used: int, *, high: object = "max", stat: str = "") -> None:
        """A cgroup of version 2."""
        self.write(path, memory_max=limit, memory_high=high, memory_current=used, memory_stat=stat)

    def first(self, path: str, limit: int, used: int, *, stat: str = "", hierarchy: int = 1) -> None:
        """A cgroup of version 1."""
        self.write(
            path,
            memory_limit_in_bytes=limit,
            memory_usage_in_bytes=used,
            memory_stat=stat,
            memory_use_hierarchy=hierarchy,
        )

    def rooms(self, process: int | str = "self", **options: Any) -> dict[str, tuple[int, int]]:
        """Limit and free memory in MiB, by the path below the mount. "" is the top cgroup, None the
        machine.
        """
        found = {}
        for room in headroom.rooms(process, **options):
            name = room.where.removeprefix("memory cgroup ").removeprefix(str(self.top)).lstrip("/")
            found[name] = (room.limit // MiB, room.left // MiB)
        return found


@pytest.fixture
def tree(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Tree:
    tree = Tree(tmp_path)
    monkeypatch.setattr(headroom, "PROC", tree.proc)
    monkeypatch.setattr(headroom._Grant, "left", 0)
    return tree


MACHINE = {"the machine": (8192, 4096)}


class TestSecondKind:
    @pytest.fixture(autouse=True)
    def mounted(self, tree: Tree) -> None:
        tree.mounts(tree.mount("cgroup2"))
        tree.is_in("0::/robot/camera")

    def test_its_own_and_those_that_it_is_in(self, tree: Tree) -> None:
        tree.second("", "max", 5000 * MiB)
        tree.second("robot", 300 * MiB, 290 * MiB)
        tree.second("robot/camera", 200 * MiB, 20 * MiB)
        assert tree.rooms() == {"robot/camera": (200, 180), "robot": (300, 10)} | MACHINE

    def test_a_namespace_of_its_own(self, tree: Tree) -> None:
        """The view from a container: its own cgroup is the top one."""
        tree.is_in("0::/")
        tree.second("", 100 * MiB, 30 * MiB)
        assert tree.rooms() == {"": (100, 70)} | MACHINE

    def test_one_above_where_it_is_throttled_has_no_room_either(self, tree: Tree) -> None:
        tree.second("robot/camera", 200 * MiB, 20 * MiB, high=50 * MiB)
        assert tree.rooms() == {"robot/camera": (50, 30)} | MACHINE

    def test_files_in_the_cache_can_go(self, tree: Tree) -> None:
        stat = f"anon 1\nfile 2\ninactive_file {40 * MiB}\nactive_file {20 * MiB}\nshmem {9 * MiB}\n"
        tree.second("robot/camera", 200 * MiB, 195 * MiB, stat=stat)
        assert tree.rooms() == {"robot/camera": (200, 55)} | MACHINE
        assert tree.rooms(need=0)["robot/camera"] == (200, 55)
        tree.second("robot/camera", 200 * MiB, 100 * MiB, stat=stat)
        # Enough is free, so the details are not read.
        assert tree.rooms(need=10 * MiB)["robot/camera"] == (200, 100)

    def test_more_than_the_limit_is_in_use(self, tree: Tree) -> None:
        tree.second("robot/camera", 100 * MiB, 120 * MiB)
        assert tree.rooms()["robot/camera"] == (100, 0)

    def test_without_limits(self, tree: Tree) -> None:
        tree.second("robot/camera", "max", 120 * MiB)
        assert tree.rooms() == MACHINE

    def test_what_cant_be_read_is_left_out(self, tree: Tree) -> None:
        tree.second("robot", 300 * MiB, 100 * MiB)
        tree.write("robot/camera", memory_max="nonsense", memory_current=1)
        assert tree.rooms() == {"robot": (300, 200)} | MACHINE
        tree.write("robot", memory_current="nonsense")
        assert tree.rooms() == MACHINE

    def test_of_another_process(self, tree: Tree) -> None:
        tree.second("robot/camera", 100 * MiB, 30 * MiB)
        tree.second("daemon", 50 * MiB, 30 * MiB)
        tree.is_in("0::/daemon", process="4711")
        assert tree.rooms(4711) == {"daemon": (50, 20)} | MACHINE
        assert tree.rooms(4712) == MACHINE  # the process has ended

    def test_a_process_that_is_put_into_another_one(self, tree: Tree) -> None:
        tree.second("robot/camera", 100 * MiB, 30 * MiB)
        assert tree.rooms() == {"robot/camera": (100, 70)} | MACHINE
        tree.second("arm", 60 * MiB, 30 * MiB)
        (tree.proc / "self" / "cgroup").write_text("0::/arm\n")
        assert tree.rooms() == {"arm": (60, 30)} | MACHINE


class TestFirstKind:
    @pytest.fixture(autouse=True)
    def mounted(self, tree: Tree) -> None:
        tree.mounts(tree.mount("cgroup", options="rw,memory"))
        tree.is_in("5:cpu,cpuacct:/elsewhere", "4:memory:/docker/abc/in", "0::/")

    def test_its_own_and_those_that_it_is_in(self, tree: Tree) -> None:
        tree.first("", UNLIMITED, 5000 * MiB)
        tree.first("docker/abc", 100 * MiB, 95 * MiB, stat=f"total_inactive_file {10 * MiB}")
        tree.first("docker/abc/in", UNLIMITED, 30 * MiB)
        assert tree.rooms() == {"docker/abc": (100, 15)} | MACHINE

    def test_mounted_from_the_containers_own_on(self, tree: Tree) -> None:
        tree.mounts(tree.mount("cgroup", "/docker/abc", "rw,memory"))
        tree.first("", 100 * MiB, 30 * MiB)
        tree.first("in", 60 * MiB, 10 * MiB)
        assert tree.rooms() == {"in": (60, 50), "": (100, 70)} | MACHINE

    def test_not_to_be_seen_from_here(self, tree: Tree) -> None:
        tree.mounts(tree.mount("cgroup", "/docker/other", "rw,memory"))
        tree.first("", 100 * MiB, 30 * MiB)
        assert tree.rooms() == {"": (100, 70)} | MACHINE

    def test_what_counts_for_itself_alone(self, tree: Tree) -> None:
        tree.first("docker", 100 * MiB, 99 * MiB, hierarchy=0)
        tree.first("docker/abc", 70 * MiB, 30 * MiB)
        tree.first("docker/abc/in", 60 * MiB, 30 * MiB)
        assert tree.rooms() == {"docker/abc/in": (60, 30), "docker/abc": (70, 40)} | MACHINE

    def test_only_the_mount_that_is_of_memory(self, tree: Tree) -> None:
        tree.mounts(
            "29 21 0:25 / /nowhere rw - cgroup cgroup rw,cpu,cpuacct",
            tree.mount("cgroup", options="rw,memory"),
        )
        tree.first("docker/abc", 100 * MiB, 95 * MiB)
        assert tree.rooms() == {"docker/abc": (100, 5)} | MACHINE


class TestMachine:
    def test_without_cgroups(self, tree: Tree) -> None:
        assert tree.rooms() == MACHINE

    def test_where_nothing_is_told(self, tree: Tree) -> None:
        (tree.proc / "meminfo").write_text("MemTotal: 5 kB\n")
        assert tree.rooms() == {}
        (tree.proc / "meminfo").unlink()
        (tree.proc / "self" / "mountinfo").unlink()
        headroom._places.cache_clear()
        assert tree.rooms() == {}
        headroom.claim(1 << 40)

    def test_the_real_one(self) -> None:
        *_, machine = headroom.rooms()
        assert machine.where == "the machine"
        assert 0 < machine.left <= machine.limit == os.sysconf("SC_PHYS_PAGES") * os.sysconf("SC_PAGE_SIZE")


@for_each(("limit_mib", "reserve_mib"), [(10, 8), (100, 8), (160, 10), (512, 32), (1024, 64), (65536, 64)])
def test_the_reserve(limit_mib: int, reserve_mib: int) -> None:
    assert Room("", limit_mib * MiB, 0).reserve == reserve_mib * MiB


class TestClaim:
    @pytest.fixture(autouse=True)
    def mounted(self, tree: Tree) -> None:
        tree.mounts(tree.mount("cgroup2"))
        tree.is_in("0::/robot")

    def test_up_to_the_reserve(self, tree: Tree) -> None:
        tree.second("robot", 100 * MiB, 70 * MiB)
        headroom.claim(14 * MiB)
        tree.second("robot", 100 * MiB, 78 * MiB)
        headroom.claim(14 * MiB)
        text = rf"memory cgroup {tree.top}/robot has 22 of 100 MiB left; this takes 15 and a reserve of 8"
        with pytest.raises(OSError, match=text) as error:
            headroom.claim(14 * MiB + 1)
        assert error.value.errno == errno.ENOMEM

    def test_beside_a_large_ring_half_as_much_stays_free(self, tree: Tree) -> None:
        """A large ring holds long messages, and programs need memory to work on them."""
        tree.second("robot", 100 * MiB, 10 * MiB)
        headroom.claim(60 * MiB)
        text = "has 90 of 100 MiB left; this takes 61 and a reserve of 31"
        with pytest.raises(OSError, match=text):
            headroom.claim(61 * MiB)
        headroom.claim(MiB, of=120 * MiB)
        with pytest.raises(OSError, match="this takes 31 and a reserve of 60"):
            headroom.claim(31 * MiB, of=120 * MiB)

    def test_of_the_machine(self, tree: Tree) -> None:
        tree.machine(8192, 100)
        headroom.claim(36 * MiB)
        with pytest.raises(
            OSError, match="the machine has 100 of 8192 MiB left; this takes 37 and a reserve of 64"
        ):
            headroom.claim(37 * MiB)

    def test_small_ones_are_granted_many_at_a_time(self, tree: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
        looks = count_looks(monkeypatch)
        tree.second("robot", 1000 * MiB, 0)
        for _ in range(100):
            headroom.claim(8192)
        assert len(looks) == 1
        headroom.claim(MiB)
        assert len(looks) == 2  # every large claim is checked
        monkeypatch.setattr(headroom, "monotonic_ns", lambda clock=headroom.monotonic_ns: clock() + 10**9)  # type: ignore[attr-defined]
        headroom.claim(8192)
        assert len(looks) == 3

    def test_what_is_granted_is_a_small_part(self, tree: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
        looks = count_looks(monkeypatch)
        tree.second("robot", 100 * MiB, 60 * MiB)
        for _ in range(1 + 2 * MiB // 8192):  # 2 MiB of 32 that are free
            headroom.claim(8192)
        assert len(looks) == 2


@pytest.mark.skipif(not has_core(), reason="the native core was not built")
class TestSegments:
    @pytest.fixture(autouse=True)
    def mounted(self, tree: Tree) -> None:
        tree.mounts(tree.mount("cgroup2"))
        tree.is_in("0::/robot")

    def test_none_is_made_of_the_reserve(self, tree: Tree) -> None:
        tree.second("robot", 100 * MiB, 95 * MiB)
        before = os.listdir("/proc/self/fd")  # noqa: PTH208
        for make in (lambda: segments.make_ring(4096, 64, 1), lambda: segments.make_readers(10)):
            with pytest.raises(OSError, match="has 5 of 100 MiB left") as error:
                make()
            assert error.value.errno == errno.ENOMEM
        assert os.listdir("/proc/self/fd") == before  # noqa: PTH208

    def test_others_take_memory_at_the_same_time(self, tree: Tree, monkeypatch: pytest.MonkeyPatch) -> None:
        """A large claim reserves memory in steps and checks each step. If one fails, the claim frees all of
        them.
        """
        tree.second("robot", 200 * MiB, 100 * MiB)
        reserve = os.posix_fallocate
        reserved = 0

        def step(number: int, start: int, size: int) -> None:
            nonlocal reserved
            reserve(number, start, size)
            reserved += size
            tree.second("robot", 200 * MiB, 100 * MiB + 3 * reserved)  # two other programs do the same

        monkeypatch.setattr(os, "posix_fallocate", step)
        before = os.listdir("/proc/self/fd")  # noqa: PTH208
        with pytest.raises(OSError, match="of 200 MiB left"):
            segments.make_ring(64 * MiB, 512, 1)
        assert 0 < reserved < 40 * MiB
        assert os.listdir("/proc/self/fd") == before  # noqa: PTH208

    def test_a_large_one_is_reserved_as_a_whole(self, tree: Tree) -> None:
        ring, memory = segments.make_ring(16 * MiB, 512, 1)
        assert os.fstat(ring.number).st_blocks * 512 >= memory.size


def count_looks(monkeypatch: pytest.MonkeyPatch) -> list[object]:
    looks: list[object] = []
    rooms: Callable[..., Any] = headroom.rooms
    monkeypatch.setattr(headroom, "rooms", lambda **options: (looks.append(options), rooms(**options))[1])
    return looks
