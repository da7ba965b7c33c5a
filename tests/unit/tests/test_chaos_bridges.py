"""tests/chaos/bridges.py: the plan of actions, and faults that its judge must find."""

import random

from chaos.bridges import plan


def test_a_seed_gives_the_same_deeds_and_so_many_of_them() -> None:
    rounds = [*plan(random.Random(7), 200)]
    assert rounds == [*plan(random.Random(7), 200)] != [*plan(random.Random(8), 200)]
    deeds = [deed for one in rounds for deed in one]
    assert len(deeds) == 200 and {deed.what for deed in deeds} == {"bridge", "busd", "pull", "down", "stop"}
    assert {deed.who for deed in deeds} == {"robot", "laptop"}


def test_every_third_round_kills_nobody() -> None:
    rounds = [*plan(random.Random(7), 200)]
    assert not any(deed.kills for one in rounds[2::3] for deed in one)
    assert any(deed.kills for one in rounds[::3] for deed in one)
