"""Machines for a test: network namespaces with cables between them, which can be pulled.

    with Machines("robot", "laptop") as machines:
        cable = machines.connect("robot", "laptop")
        subprocess.Popen([*machines["robot"].prefix, "ping", cable.address_of("laptop")])
        with cable.pulled():
            ...

A namespace has no name and no file: a separate process holds it until its standard input ends. So it ends
with the test's process in any case, and parallel tests can't collide. Each machine has its own loopback, and
its own /dev/shm, by which Fast DDS would find the others.

busd's sockets are files, which all machines share: programs that only talk to a busd may run anywhere.
"""

import json
import subprocess
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from functools import cache
from types import TracebackType
from typing import Self

_SET_UP = (
    "ip link set lo up multicast on && ip route add 224.0.0.0/4 dev lo && mount -t tmpfs none /dev/shm"
    " && echo ready && exec cat"
)
_WAIT_UNTIL_UP = 'until ip -brief link show "$1" | grep -q " UP "; do sleep 0.01; done'
_TIMEOUT_S = 20.0
_NOBODY = "02:00:00:00:00:77"
"""An Ethernet address that no interface has."""


@cache
def why_not() -> str:
    """The reason why namespaces are impossible here; empty if they are possible."""
    try:
        with Machines("here", "there") as machines:
            machines.connect("here", "there")
    except (OSError, RuntimeError, subprocess.SubprocessError) as error:
        return f"network namespaces need root, unshare, nsenter and ip: {error}"
    return ""


class Machine:
    """A network namespace; made by `Machines`."""

    def __init__(self, name: str) -> None:
        self.name = name
        command = ["unshare", "--net", "--mount", "sh", "-c", _SET_UP]
        self._holder = subprocess.Popen(
            command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
        assert self._holder.stdout is not None
        said = self._holder.stdout.readline()
        if said != "ready\n":
            self.close()
            raise RuntimeError(said.strip() or "unshare has failed")
        self.pid = self._holder.pid
        self.prefix = ("nsenter", "--target", str(self.pid), "--net", "--mount", "--")
        """The first words of a command that runs there; it remains the same process."""
        self.cables = 0

    def run(self, *command: str) -> str:
        """The output of a command there. Raises RuntimeError if it fails."""
        return _run(*self.prefix, *command)

    def close(self) -> None:
        """Release it; it lives on as long as programs run in it."""
        assert self._holder.stdin is not None and self._holder.stdout is not None
        self._holder.stdin.close()
        self._holder.stdout.close()
        self._holder.wait(_TIMEOUT_S)


class Cable:
    """Two interfaces, one on each machine, with their own network.

    It can be broken in two ways, which programs see differently.
    """

    def __init__(self, number: int, ends: tuple[Machine, Machine]) -> None:
        self._ends = {machine.name: machine for machine in ends}
        self._places: dict[str, tuple[str, str]] = {}
        words: list[str] = ["ip", "link", "add"]
        for place, machine in enumerate(ends, 1):
            interface = f"eth{machine.cables}"
            machine.cables += 1
            self._places[machine.name] = interface, f"10.77.{number}.{place}"
            words += [*(["type", "veth", "peer"] if place > 1 else []), "name", interface]
            words += ["netns", str(machine.pid)]
        _run(*words)
        for machine in ends:
            interface, address = self._places[machine.name]
            machine.run("ip", "address", "add", f"{address}/24", "dev", interface)
            machine.run("ip", "link", "set", interface, "up")
        for machine in ends:  # the kernel says so later, and Fast DDS passes over an interface until then
            machine.run("sh", "-c", _WAIT_UNTIL_UP, "sh", self._places[machine.name][0])

    def address_of(self, machine: str) -> str:
        """The address of a machine for the other end."""
        return self._places[machine][1]

    def interface_of(self, machine: str) -> str:
        return self._places[machine][0]

    def sent_by(self, machine: str) -> int:
        """Bytes that a machine has sent on it, with all headers."""
        told = self._ends[machine].run(
            "ip", "-json", "-statistics", "link", "show", self.interface_of(machine)
        )
        return int(json.loads(told)[0]["stats64"]["tx"]["bytes"])

    @contextmanager
    def pulled(self) -> Iterator[None]:
        """Drop everything between the two machines, without an error: sent data are lost in transit."""
        for name, address in self._addresses():
            machine, interface = self._ends[name], self._places[name][0]
            words = ("neigh", "replace", address, "lladdr", _NOBODY, "dev", interface, "nud", "permanent")
            machine.run("ip", *words)
        try:
            yield
        finally:
            for name, address in self._addresses():
                self._ends[name].run("ip", "neigh", "del", address, "dev", self._places[name][0])

    @contextmanager
    def down(self) -> Iterator[None]:
        """Switch the interface of one end off: the other has no carrier, so sending fails with an error."""
        name, (interface, _) = next(iter(self._places.items()))
        machine = self._ends[name]
        machine.run("ip", "link", "set", interface, "down")
        try:
            yield
        finally:
            machine.run("ip", "link", "set", interface, "up")

    def _addresses(self) -> Iterator[tuple[str, str]]:
        """Each machine, and the address of the other one."""
        for name in self._places:
            yield from ((name, address) for other, (_, address) in self._places.items() if other != name)


class Machines:
    """The machines of a test, by name. Leaving releases them."""

    def __init__(self, *names: str) -> None:
        self._names = names
        self._machines: dict[str, Machine] = {}
        self._cables = 0
        self._stack = ExitStack()

    def __getitem__(self, name: str) -> Machine:
        return self._machines[name]

    def connect(self, one: str, other: str) -> Cable:
        """Lay a cable between two of them."""
        self._cables += 1
        return Cable(self._cables, (self[one], self[other]))

    def __enter__(self) -> Self:
        with ExitStack() as stack:
            for name in self._names:
                self._machines[name] = machine = Machine(name)
                stack.callback(machine.close)
            self._stack = stack.pop_all()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._stack.close()


def _run(*command: str) -> str:
    done = subprocess.run(command, capture_output=True, text=True, timeout=_TIMEOUT_S, check=False)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)}: {done.stderr.strip()}")
    return done.stdout
