from bus.vocabulary import DropReason
from bus_bridge.core.accounts import Account


def test_what_is_neither_sent_nor_dropped_waits() -> None:
    account = Account()
    account.taken = 10
    account.sent = 3
    account.drop(DropReason.REPLACED, 2)
    account.drop(DropReason.EXPIRED)
    account.drop(DropReason.EXPIRED, 0)
    assert account.waiting == 4
    assert account.losses == {"replaced": 2, "expired": 1}


def test_what_never_came_counts_apart() -> None:
    account = Account()
    account.lost = 5
    assert account.waiting == 0
    assert account.losses == {"lost_on_the_way": 5}
    assert account.dropped == {}


def test_a_message_lost_in_the_engine_counts_once_although_its_number_is_missing() -> None:
    account = Account()
    account.miss(3, in_engine=1)
    assert account.lost == 2
    account.miss(1, in_engine=1)
    assert account.lost == 3
    account.miss(1, in_engine=4)  # the numbers of two of them are no gap: they were the first
    account.miss(1, in_engine=4)
    assert account.lost == 4


def test_losses_that_a_far_side_claims_have_a_limit() -> None:
    account = Account()
    for _ in range(3):
        account.miss(2**63, in_engine=0)
    assert account.losses == {"lost_on_the_way": 2**53 - 1}
