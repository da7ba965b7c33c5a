"""Invariants of all matches of a broker."""

from busd.core.graph import Graph
from busd.core.match import MatchState


def check_matches(graph: Graph) -> None:
    """Check that both ends know each match, and that the publishers' tables agree with the states."""
    for publisher in graph.publishers.values():
        matches = publisher.matches
        for number, match in matches.items():
            assert match.publisher is publisher and match.subscription is graph.subscriptions[number]
            assert match.subscription.matches[publisher.id] is match
            assert match.state not in (MatchState.NEW, MatchState.ENDED)
        in_state = {
            state: [number for number in sorted(matches) if matches[number].state is state]
            for state in MatchState
        }
        assert sorted(publisher.routed) == in_state[MatchState.ROUTED]
        assert all(one is matches[number].subscription for number, one in publisher.routed.items())
        assert sorted(publisher.ahead) == in_state[MatchState.AHEAD]
        assert all(one is matches[number] for number, one in publisher.ahead.items())
        awaited = [number for number in sorted(matches) if matches[number].acked_seq is not None]
        assert sorted(publisher.awaited) == awaited
        assert all(one is matches[number] for number, one in publisher.awaited.items())
        assert all(one.is_lossless and not one.is_shared for one in publisher.awaited.values())
    for subscription in graph.subscriptions.values():
        for number, match in subscription.matches.items():
            assert match.subscription is subscription
            assert graph.publishers[number].matches[subscription.id] is match
