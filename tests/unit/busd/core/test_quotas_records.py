"""busd.core.quotas: reports on the resources that processes and users hold, and the users in them."""

import pytest

from broker_world import ALL_MAY, UID, Process, Refusal, World
from bus.qos import QoSProfile
from bus.wire import messages as m
from busd.core.limits import Limits

OTHER_UID = UID + 1


def world_of(**limits: float) -> World:
    return World(Limits(**limits), access=(ALL_MAY,))  # type: ignore[arg-type]


def asked(process: Process) -> m.Peers:
    return process.request(m.GetPeers(request=0), m.Peers)


class TestRecords:
    def test_what_is_told(self) -> None:
        world = world_of(nodes_per_peer=1)
        talker, listener = world.process("talker", shares=True), world.process("listener")
        publisher = talker.publisher("/topic", QoSProfile(durability="transient_local"))
        listener.subscription("/topic", QoSProfile(depth=5))
        listener.subscription("/other")
        listener.is_blocked = True
        publisher.publish("x" * 100)
        with pytest.raises(Refusal):
            talker.node()
        world.advance(2)
        tool = world.process("tool")
        answer = asked(tool)
        first, second, third = answer.peers
        assert (first.program, first.pid, first.uid, first.refused) == ("talker", 100, UID, 1)
        assert (first.nodes, first.endpoints, first.topics, first.matches) == (1, 1, 1, 1)
        assert (first.descriptors, first.history_bytes > 100, first.silent_s) == (4, True, 2.0)
        assert (second.endpoints, second.topics, second.descriptors) == (2, 2, 1)
        assert second.queued_bytes == first.history_bytes
        assert (third.program, third.endpoints) == ("tool", 0)
        (user,) = answer.users
        assert (user.uid, user.connections, user.endpoints, user.topics) == (UID, 3, 3, 2)
        assert (user.descriptors, user.refused) == (6, 1)
        assert (user.queued_bytes, user.history_bytes) == (second.queued_bytes, first.history_bytes)
        assert answer.limits["nodes_per_peer"] == 1
        assert set(answer.limits) == set(Limits.__struct_fields__)
        assert answer.routing.runs == 0

    @pytest.mark.parametrize("uid", [0, UID])
    def test_root_and_the_owner_see_all(self, uid: int) -> None:
        world = world_of()
        world.process(uid=OTHER_UID).publisher("/topic").publish("x")
        answer = asked(world.process(uid=uid))
        assert {one.uid for one in answer.peers} == {one.uid for one in answer.users} == {OTHER_UID, uid}
        assert answer.routing.samples == 1

    def test_others_see_themselves(self) -> None:
        world = world_of()
        world.process().publisher("/topic").publish("x")
        answer = asked(world.process(uid=OTHER_UID))
        assert [one.uid for one in answer.peers] == [one.uid for one in answer.users] == [OTHER_UID]
        assert answer.routing == m.RoutingRecord()

    def test_who_has_left_is_not_told(self) -> None:
        world = world_of()
        gone = world.process(uid=OTHER_UID)
        gone.node()
        gone.die()
        assert [one.uid for one in asked(world.process()).users] == [UID]

    def test_users_are_forgotten(self) -> None:
        world = world_of()
        for uid in range(5000, 5100):
            process = world.process(uid=uid)
            process.node()
            process.die()
            world.advance(60)
        assert len(world.broker._quotas.users) == 1
