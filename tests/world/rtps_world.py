"""Participants of RTPS on a network without sockets, whose time jumps."""

from collections.abc import Callable
from typing import Protocol

from bus_bridge.rtps.announcements import EndpointData, ParticipantData
from bus_bridge.rtps.client import ClientParticipant
from bus_bridge.rtps.far import USUAL_BOUNDS, Bounds
from bus_bridge.rtps.ids import FAST_DDS, OUR_VENDOR
from bus_bridge.rtps.own_announcements import Settings
from bus_bridge.rtps.parameters import Address
from bus_bridge.rtps.participant import Participant

MS = 1_000_000
S = 1000 * MS
GROUP: Address = ("239.255.0.1", 7400)


class Acting(Protocol):
    """A participant or a server: it receives datagrams, and acts at its time."""

    @property
    def due_ns(self) -> int | None: ...
    def act(self, now_ns: int) -> None: ...
    def receive(self, datagram: bytes, source: Address, now_ns: int) -> None: ...


class Member(Protocol):
    """A machine on a Network."""

    @property
    def address(self) -> Address: ...
    @property
    def is_cut(self) -> bool: ...
    @property
    def participant(self) -> Acting: ...


class Machine:
    """A participant, with the news that it gave."""

    def __init__(
        self,
        network: "Network",
        host: str,
        bounds: Bounds,
        wanted: Callable[[str], bool],
        peers: tuple[Address, ...],
        *,
        is_client: bool = False,
    ) -> None:
        self.vendor = FAST_DDS if is_client else OUR_VENDOR
        self.address: Address = host, 7410
        self.far: dict[bytes, EndpointData] = {}
        self.participants: set[bytes] = set()
        self.warnings: list[str] = []
        self.network = network
        number = len(network.machines) + 1
        settings = Settings(
            OUR_VENDOR + number.to_bytes(10, "big"),
            (self.address,),
            peers,
            is_client=is_client,
            user_data=b"enclave=/;",
            datagram_bytes=1400,
            fragment_bytes=500,
            bounds=bounds,
        )
        make = ClientParticipant if is_client else Participant
        self.participant: Participant = make(settings, self.transmit, self, lambda one: wanted(one.topic))
        self.is_cut = False

    def transmit(self, address: Address, datagram: bytes) -> None:
        if not self.is_cut:
            self.network.send(self, address, datagram)

    def participant_added(self, data: ParticipantData) -> None:
        assert data.prefix not in self.participants
        self.participants.add(data.prefix)

    def participant_removed(self, prefix: bytes) -> None:
        self.participants.remove(prefix)
        assert not any(guid.startswith(prefix) for guid in self.far)

    def endpoint_added(self, endpoint: EndpointData, vendor: bytes) -> None:
        assert endpoint.guid not in self.far and vendor == self.vendor
        self.far[endpoint.guid] = endpoint

    def endpoint_removed(self, endpoint: EndpointData) -> None:
        assert self.far.pop(endpoint.guid) == endpoint

    def warn(self, text: str) -> None:
        self.warnings.append(text)


class Network:
    """Machines, and datagrams under way; `loses` decides about each by its number."""

    def __init__(self, loses: Callable[[int], bool] = lambda number: False) -> None:
        self.machines: list[Member] = []
        self.now_ns = 1000 * S
        self.sent = 0
        self.loses = loses
        self._under_way: list[tuple[int, Member, Address, bytes]] = []

    def add(
        self,
        host: str,
        bounds: Bounds = USUAL_BOUNDS,
        wanted: Callable[[str], bool] = lambda topic: True,
        peers: tuple[Address, ...] = (GROUP,),
        *,
        is_client: bool = False,
    ) -> Machine:
        machine = Machine(self, host, bounds, wanted, peers, is_client=is_client)
        self.machines.append(machine)
        machine.participant.start(self.now_ns)
        return machine

    def send(self, source: Member, address: Address, datagram: bytes) -> None:
        self.sent += 1
        if self.loses(self.sent):
            return
        for machine in self.machines:
            if machine is not source and address in (machine.address, GROUP):
                self._under_way.append((self.now_ns + MS, machine, source.address, datagram))

    def run(self, seconds: float) -> None:
        """Let time pass."""
        end_ns = self.now_ns + int(seconds * S)
        while True:
            due = [machine.participant.due_ns for machine in self.machines]
            times = [one for one in due if one is not None] + [one[0] for one in self._under_way]
            if not times or min(times) > end_ns:
                break
            self.now_ns = max(self.now_ns, min(times))
            arrived = [one for one in self._under_way if one[0] <= self.now_ns]
            self._under_way = [one for one in self._under_way if one[0] > self.now_ns]
            for _, machine, source, datagram in arrived:
                if not machine.is_cut:
                    machine.participant.receive(datagram, source, self.now_ns)
            for machine in self.machines:
                due_ns = machine.participant.due_ns
                if due_ns is not None and due_ns <= self.now_ns:
                    machine.participant.act(self.now_ns)
        self.now_ns = end_ns
