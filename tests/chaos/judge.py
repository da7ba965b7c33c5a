"""Invariants of the actors' reports at quiet moments. Pure: scenes in, complaints out.

A scene has the reports of one quiet moment: nothing is published, everything published was handed over, busd
and all living processes are awake. The accounts are closed from one scene to the next, over the storm
between:

- A pair of a talker and an ear is *steady* if it was matched before the storm and both ends lived through it.
  Each message published in the storm is delivered, or dropped with a reason. busd may have died meanwhile,
  any number of times.
- A talker may come in the storm and leave in order, while the ear is connected to a living busd. Its messages
  are accounted for in the same way, also if the ear is cut off later: messages waiting for it then have a
  reason.
- In other pairs, one end came, went or died, or the ear's own connection broke while busd lived. (Then the
  ear has left, and come back as a new one.) The ear accounts at least for the messages that it got, and at
  most for the published ones.

So an ear's delivered + dropped is between two bounds, which are equal if all of its pairs are steady.
Lossless pairs drop nothing if both ends lived through the storm, whichever was cut off. Exception: one of the
two processes stood still for long.

Two more exceptions are for busd's own losses:

- By socket, drops that a killed busd had not yet reported are unknown, and reported ones may be counted
  again. If an end of a pair by socket has lost busd in a storm in which busd died, only the ear's own account
  must close. It is not compared with the talkers'.
- A talker by shared memory that was cut off by a living busd may come back without its ring. Then messages
  that its ear had read there may be counted as dropped once more.

If an ear was cut off, and a talker was killed, busd may count the missed messages later: the talker could
come back with its history. So such an ear may have more in the scenes of the next SETTLE_S.

Always, also by socket if busd died: an ear has counted as dropped all numbers missing between two numbers of
one talker. Exception: one of the two was cut off by a living busd.
"""

from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field

from busd.core.absent import RETURN_NS
from chaos.roles import Ear, EarLook, Heard, Role, Talker

SETTLE_S = RETURN_NS / 1e9 + 5.0
"""The time for which busd waits for a killed talker, plus a reserve: the machine may be busy."""


@dataclass(frozen=True)
class Said:
    """The messages that a talker has published, at least and at most: for a dead one they may differ."""

    talker: Talker
    actor: str
    least: int
    most: int
    lives: bool = True
    witnesses: frozenset[str] = frozenset()
    """Actors that were connected from its begin to its end, which came before the quiet moment."""


@dataclass
class Scene:
    """A quiet moment. It includes talkers that have gone since the previous one."""

    talkers: dict[int, Said] = field(default_factory=dict)
    ears: dict[int, tuple[Ear, str, EarLook]] = field(default_factory=dict)
    losses: dict[str, int] = field(default_factory=dict)
    """How often each living actor has lost busd."""
    deaths: int = 0
    """How often busd has ended."""
    sleepers: set[str] = field(default_factory=set)
    """Actors that were stopped or asleep so long in the storm that others may have continued without them."""
    roles: dict[str, Role] = field(default_factory=dict)
    at_s: float = field(default=0.0, compare=False)
    unsettled: dict[int, list[tuple[float, int]]] = field(default_factory=dict)
    """For each ear: times and numbers of further drops allowed until then: see `note_unsettled`."""

    def lives(self, number: int) -> bool:
        """Whether a talker is alive."""
        return number in self.talkers and self.talkers[number].lives

    def graph(self) -> Counter[tuple[str, ...]]:
        """The expected content of busd's graph: nodes, and endpoints with their kind and topic."""
        found: Counter[tuple[str, ...]] = Counter((name,) for name in self.losses)
        found.update((one.actor, "publisher", one.talker.topic) for one in self.talkers.values() if one.lives)
        found.update((actor, "subscription", ear.topic) for ear, actor, _ in self.ears.values())
        return found


def judge(before: Scene, now: Scene, *, trusts_cut_off: bool = True) -> list[str]:
    """All violations in `now`, in words.

    `trusts_cut_off`: if a living busd has cut off an ear, its account is compared with the talkers' reports.
    """
    return [*_waiting(now), *_accounts(before, now, trusts_cut_off), *_streams(before, now)]


def _waiting(now: Scene) -> Iterator[str]:
    for number, (ear, actor, look) in now.ears.items():
        if look.queued:
            yield f"{_ear(number, ear, actor)}: {look.queued} messages still wait"
        delivered = sum(heard.messages for heard in look.heard.values())
        if look.delivered != delivered:
            yield f"{_ear(number, ear, actor)}: {look.delivered} counted as delivered, {delivered} were"
        accounted = look.delivered + look.queued + sum(look.dropped.values())
        if look.expected != accounted:
            yield f"{_ear(number, ear, actor)}: {look.expected} expected, {accounted} accounted for"


def note_unsettled(before: Scene, now: Scene) -> None:
    """Note in `now`, for each ear, how many missed messages busd may count later."""
    for number, (_, actor, _) in now.ears.items():
        late = [(until_s, count) for until_s, count in before.unsettled.get(number, ()) if until_s > now.at_s]
        if number in before.ears and _was_cut_off(before, now, actor):
            account = _add_up(before, now, number)
            if account.has_dead:
                late.append((now.at_s + SETTLE_S, max(0, account.most - account.total)))
        if late:
            now.unsettled[number] = late


@dataclass
class _Account:
    """The account of one ear, from one scene to the next."""

    got: int
    dropped: dict[str, int]
    least: int = 0
    most: int = 0
    gaps: int = 0
    is_unsure: bool = False
    may_be_more: bool = False
    has_dead: bool = False
    """Whether there is a talker that was killed."""
    parts: list[str] = field(default_factory=list)

    @property
    def total(self) -> int:
        return self.got + sum(self.dropped.values())


def _accounts(before: Scene, now: Scene, trusts_cut_off: bool) -> Iterator[str]:
    for number, (ear, actor, _) in now.ears.items():
        if number not in before.ears or now.roles[actor].is_limited:
            continue
        account = _add_up(before, now, number, trusts_cut_off=trusts_cut_off)
        least, total, dropped = account.least, account.total, account.dropped
        most = account.most + sum(count for _, count in before.unsettled.get(number, ()))
        name, parts = _ear(number, ear, actor), ", ".join(account.parts)
        if account.gaps > sum(dropped.values()):
            yield f"{name}: {account.gaps} missing between others, dropped {dropped}: {parts}"
        if not (account.is_unsure or (least <= total and (account.may_be_more or total <= most))):
            owed = f"{least}" if least == most else f"{least} to {most}"
            yield (
                f"{name}: {account.got} delivered + dropped {dropped} = {total}, published {owed}: {parts}"
            )


def _add_up(before: Scene, now: Scene, number: int, *, trusts_cut_off: bool = True) -> _Account:
    has_died = now.deaths > before.deaths
    ear, actor, look = now.ears[number]
    then = before.ears[number][2]
    dropped = {
        reason: count - then.dropped.get(reason, 0)
        for reason, count in look.dropped.items()
        if count != then.dropped.get(reason, 0)
    }
    account = _Account(look.delivered - then.delivered, dropped)
    for said in now.talkers.values():
        if said.talker.topic != ear.topic or not said.talker.quality.serves(ear.quality):
            continue
        got = _heard(look, said).messages - _heard(then, said).messages
        known = before.talkers.get(said.talker.number)
        upper = said.most - (known.most if known else 0)
        is_steady = _is_steady(before, now, said, actor)
        if is_steady and known is not None:
            account.gaps += _new_gaps(_heard(then, said), _heard(look, said), known.most)
        account.least += upper if is_steady or actor in said.witnesses else got
        account.most += upper
        account.has_dead |= not said.lives and not said.witnesses
        account.may_be_more |= _may_lose_its_ring(before, now, said, actor)
        if (has_died or not trusts_cut_off) and _is_by_socket(now, said, actor):
            account.is_unsure |= any(_losses(before, now, name) for name in (said.actor, actor))
        account.parts.append(f"{_name(said)}{'' if is_steady else ' (not steady)'}: {got} of {upper}")
    return account


def _new_gaps(then: Heard, now: Heard, published: int) -> int:
    """The number of gaps in numbers above `published`, which was the last one `then`.

    Losses at the end of the previous scene were counted there.
    """
    if not then.messages or now.last == then.last:
        return 0
    return now.missing - then.missing - (published - then.last)


def _is_steady(before: Scene, now: Scene, said: Said, actor: str) -> bool:
    """Whether a talker and an ear of `actor`, which lived through the storm, were matched all the time."""
    number = said.talker.number
    if not (before.lives(number) and now.lives(number)):
        return False
    return not any(_was_cut_off(before, now, name) for name in (said.actor, actor))


def _is_by_socket(now: Scene, said: Said, actor: str) -> bool:
    """Whether messages may come through busd; unknown for talkers that are gone."""
    mouth = now.roles.get(said.actor)
    return mouth is None or mouth.is_limited or mouth.by_socket or now.roles[actor].by_socket


def _may_lose_its_ring(before: Scene, now: Scene, said: Said, actor: str) -> bool:
    """Whether a talker by shared memory may have come back by socket."""
    if now.roles[actor].by_socket:
        return False
    if said.actor not in now.losses:
        return not said.witnesses  # it has died, so this is unknown
    return not _is_by_socket(now, said, actor) and _was_cut_off(before, now, said.actor)


def _losses(before: Scene, now: Scene, actor: str) -> int:
    """How often it has lost busd in the storm, if it exists."""
    return now.losses.get(actor, 0) - before.losses.get(actor, 0)


def _was_cut_off(before: Scene, now: Scene, actor: str) -> bool:
    """Whether an actor may have lost its connection to a living busd."""
    losses = _losses(before, now, actor)
    return losses > (0 if now.roles[actor].is_fragile else now.deaths - before.deaths)


def _streams(before: Scene, now: Scene) -> Iterator[str]:
    """Check that pairs with reliable + keep all at both ends are complete."""
    for number, (ear, actor, look) in now.ears.items():
        if not ear.quality.is_lossless or now.roles[actor].is_limited or number not in before.ears:
            continue
        if actor in now.sleepers:
            continue
        then = before.ears[number][2]
        for said in now.talkers.values():
            talker = said.talker
            is_stream = talker.topic == ear.topic and talker.quality.is_lossless
            lived = before.lives(talker.number) and now.lives(talker.number)
            if not (is_stream and lived) or said.actor in now.sleepers:
                continue
            if not _is_steady(before, now, said, actor) and _may_lose_its_ring(before, now, said, actor):
                continue
            heard = _heard(look, said)
            if missing := heard.missing - _heard(then, said).missing:
                yield f"{_ear(number, ear, actor)}: {missing} of {_name(said)} are missing"
            if heard.last != said.most:
                yield (
                    f"{_ear(number, ear, actor)}: heard {_name(said)} up to {heard.last}, "
                    f"it published {said.most}"
                )


def history(talkers: list[Said], ear: Ear, look: EarLook) -> list[str]:
    """Violations in the history that an ear received after coming at a quiet moment."""
    wrong = []
    for said in talkers:
        talker = said.talker
        if talker.topic != ear.topic or not talker.quality.serves(ear.quality):
            continue
        wanted = 0
        if ear.quality.is_durable:
            wanted = min(said.most, talker.quality.depth, ear.quality.depth or said.most)
        expected = Heard(wanted, said.most - wanted + 1, said.most) if wanted else Heard()
        found = _heard(look, said)
        if found != expected:
            wrong.append(
                f"late ear {ear.number} of depth {ear.quality.depth} heard of {_name(said)} of depth "
                f"{talker.quality.depth}, published {said.most}: {_range(found)}, not {_range(expected)}"
            )
    return wrong


def _range(heard: Heard) -> str:
    if not heard.messages:
        return "nothing"
    return f"{heard.messages} from {heard.first} to {heard.last}"


def _heard(look: EarLook, said: Said) -> Heard:
    return look.heard.get(said.talker.number, Heard())


def _name(said: Said) -> str:
    return f"{said.talker.number} ({said.actor})"


def _ear(number: int, ear: Ear, actor: str) -> str:
    return f"{actor}, ear {number} on {ear.topic}"
