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
