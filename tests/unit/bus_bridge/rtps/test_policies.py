"""Policies of DDS: a writer must offer at least what a reader requests."""

from bus_bridge.rtps.policies import MANUAL_BY_TOPIC, TRANSIENT_LOCAL, Policies, is_compatible
from rows import for_each

PLAIN = Policies()


@for_each(
    ("less", "more"),
    [
        (Policies(reliable=False), PLAIN),
        (PLAIN, Policies(durability=TRANSIENT_LOCAL)),
        (PLAIN, Policies(deadline_ns=1)),
        (Policies(deadline_ns=2), Policies(deadline_ns=1)),
        (PLAIN, Policies(liveliness=1)),
        (Policies(liveliness=1), Policies(liveliness=MANUAL_BY_TOPIC)),
        (Policies(lease_ns=2), Policies(lease_ns=1)),
    ],
)
def test_each_policy(less: Policies, more: Policies) -> None:
    assert is_compatible(more, less)
    assert is_compatible(more, more)
    assert not is_compatible(less, more)


@for_each("other", [Policies(keep_all=True), Policies(depth=7), Policies(lifespan_ns=1)])
def test_policies_of_one_side_only(other: Policies) -> None:
    assert is_compatible(PLAIN, other)
    assert is_compatible(other, PLAIN)


def test_words() -> None:
    assert (PLAIN.transient_local, PLAIN.manual) == (False, False)
    more = Policies(durability=TRANSIENT_LOCAL, liveliness=MANUAL_BY_TOPIC)
    assert (more.transient_local, more.manual) == (True, True)
