"""Accounts with a parent: each charge to a child is also charged to the parent, for every order of runs."""

from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, invariant, rule

from bus.wire.runs import RUN_COST_BYTES, Account, Run, RunQueue
from effort import examples
from feeding import frame_record

WHOSE = st.integers(0, 3)


def run_of(count: int, size: int, *, is_replay: bool = False, lifespan_ns: int = 0) -> Run:
    return Run(0, 1, 1, count, frame_record(bytes(size), 5) * count, is_replay, lifespan_ns)


class Tree(RuleBasedStateMachine):
    """Four queues of three processes of two users; `held` is the sum over the runs of an account's queues."""

    def __init__(self) -> None:
        super().__init__()
        self.users = [Account(6 * RUN_COST_BYTES), Account(1 << 30)]
        alice, bob = self.users
        one, other, third = Account(4 * RUN_COST_BYTES, alice), Account(1 << 30, alice), Account(1 << 30, bob)
        self.processes = [one, other, third]
        self.queues = [RunQueue(4, one), RunQueue(0, one), RunQueue(6, other), RunQueue(0, third)]

    def held(self, account: Account) -> int:
        held = 0
        for queue in self.queues:
            if queue.account is account:
                held += sum(len(run.body) + RUN_COST_BYTES for run in queue.runs)
        return held

    @rule(at=WHOSE, count=st.integers(1, 4), size=st.integers(0, 300), is_replay=st.booleans())
    def append(self, at: int, count: int, size: int, is_replay: bool) -> None:
        queue = self.queues[at]
        must_trim = queue.append(run_of(count, size, is_replay=is_replay, lifespan_ns=at % 2 * 10))
        parent = queue.account.parent
        assert parent is not None
        assert must_trim == (queue.count > queue.bound or queue.account.is_over or parent.is_over)

    @rule(at=WHOSE)
    def pop(self, at: int) -> None:
        if self.queues[at].runs:
            self.queues[at].pop_frame()

    @rule(at=WHOSE, count=st.integers(0, 5))
    def drop(self, at: int, count: int) -> None:
        self.queues[at].drop(count)

    @rule(at=WHOSE)
    def trim(self, at: int) -> None:
        self.queues[at].trim()

    @rule(at=WHOSE, now_ns=st.integers(0, 30))
    def expire(self, at: int, now_ns: int) -> None:
        self.queues[at].drop_expired(now_ns)

    @rule(at=WHOSE, spare=st.integers(0, 1), slack=st.integers(0, 500), of_user=st.booleans())
    def shed(self, at: int, spare: int, slack: int, of_user: bool) -> None:
        queue = self.queues[at]
        account = queue.account.parent if of_user else queue.account
        assert account is not None
        queue.drop_over_quota(spare=spare, account=account, slack=slack)
        assert len(queue.runs) <= spare or account.used <= account.limit - slack

    @rule(at=WHOSE)
    def clear(self, at: int) -> None:
        self.queues[at].clear()
        assert self.queues[at].held_bytes == 0

    @invariant()
    def sums_agree(self) -> None:
        assert [process.used for process in self.processes] == list(map(self.held, self.processes))
        for user in self.users:
            assert user.used == sum(one.used for one in self.processes if one.parent is user)


TestTree = Tree.TestCase
TestTree.settings = settings(max_examples=examples(60), stateful_step_count=40, deadline=None)
