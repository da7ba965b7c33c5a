"""`bus topic info`: a topic's type and endpoints; with -v their QoS, losses and matches."""

import time
from argparse import ArgumentParser, Namespace
from functools import cache
from typing import Any

from bus.diagnostics.mismatch import Describe, kept_apart, mismatch
from bus.graph import EndpointStatistics, Graph, GraphEndpoint
from bus.process.address import socket_path
from bus.qos import History, describe_profile
from bus_cli.completion import completed_by, topics
from bus_cli.origin import origin_record, origin_text
from bus_cli.output import CommandError, dropped_text, print_json, say, size_text
from bus_cli.query import Query, full_topic_name

_RATE_S = 1.2
"""Longest time that the rate of a topic takes, if there is advice that needs it."""
_LOOK_S = 0.1


def add_arguments(parser: ArgumentParser) -> None:
    completed_by(
        parser.add_argument("topic_name", help="Name of the topic to get info (e.g. '/chatter')"), topics
    )
    parser.add_argument(
        "-v",
        "--verbose",
        action="store_true",
        help="Prints detailed information like the node name, node namespace, topic type, topic type hash, "
        "GID, QoS profile, message counts, queue, drops and matches of the publishers and subscriptions",
    )


def main(args: Namespace) -> int:
    topic = full_topic_name(args.topic_name)
    with Query(socket_path(args.socket, args.domain)) as query:
        graph = query.graph(statistics=args.verbose)
        taps = [one for one in graph.taps if one.topic == topic] if args.verbose else []
        there = [*graph.publishers_of(topic), *graph.subscriptions_of(topic), *taps] if args.verbose else []
        describe = cache(query.description)
        matches = {one.id: _matches(graph, one, describe) for one in there}
        hz = _hz(query, graph, topic) if any(map(_needs_rate, there)) else None
        advices = {one.id: _advice(one, hz) for one in there}
    types = graph.topics().get(topic)
    if types is None:
        from bus_cli.suggestions import near_topic

        raise CommandError(f"Unknown topic '{args.topic_name}'{near_topic(topic, graph)}")
    sides = [("Publisher", graph.publishers_of(topic)), ("Subscription", graph.subscriptions_of(topic))]
    sides += [("Tap", taps)] if taps else []
    if args.json:
        record: dict[str, Any] = {"topic": topic, "types": types}
        for name, endpoints in sides:
            record[f"{name.lower()}_count"] = len(endpoints)
            if args.verbose:
                record[f"{name.lower()}s"] = [
                    _record(endpoint, matches[endpoint.id], advices[endpoint.id]) for endpoint in endpoints
                ]
        print_json(record)
        return 0
    end = "\n\n" if args.verbose else "\n"
    say(f"Type: {types[0] if len(types) == 1 else types}", end=end)
    for name, endpoints in sides:
        say(f"{name} count: {len(endpoints)}", end=end)
        if args.verbose:
            for endpoint in endpoints:
                say("\n".join(_block(endpoint, matches[endpoint.id], advices[endpoint.id])), end=end)
    return 0


def _hz(query: Query, graph: Graph, topic: str) -> float | None:
    """Messages published a second, from a further look at the counters; None if there are no new ones.

    Processes report their counters twice a second.
    """
    before = {one.gid: one.statistics or EndpointStatistics() for one in graph.publishers_of(topic)}
    end_s, rates = time.monotonic() + _RATE_S, dict[bytes, float]()
    while len(rates) < len(before) and time.monotonic() < end_s:
        time.sleep(_LOOK_S)
        for one in query.graph(statistics=True).publishers_of(topic):
            now, old = one.statistics or EndpointStatistics(), before.get(one.gid)
            if old is not None and now.at_ns > old.at_ns > 0 and now.samples > old.samples:
                rates[one.gid] = (now.samples - old.samples) * 1e9 / (now.at_ns - old.at_ns)
    return sum(rates.values()) if rates else None


def _advice(endpoint: GraphEndpoint, hz: float | None = None) -> str:
    if endpoint.kind == "publisher" or endpoint.statistics is None:
        return ""
    from bus_web.advice import advice

    return advice(endpoint.qos, endpoint.statistics, hz)


def _needs_rate(endpoint: GraphEndpoint) -> bool:
    return _advice(endpoint) != _advice(endpoint, 1.0)


def _block(endpoint: GraphEndpoint, matches: list[dict[str, str]], advice: str) -> list[str]:
    counters = endpoint.statistics or EndpointStatistics()
    lines = [
        f"Node name: {endpoint.node.name}",
        f"Node namespace: {endpoint.node.namespace}",
        *([] if endpoint.node.origin is None else [f"Origin: {origin_text(endpoint.node.origin)}"]),
        f"Topic type: {endpoint.type_name}",
        f"Topic type hash: {endpoint.type_hash}",
        f"Endpoint type: {endpoint.kind.upper()}",
        f"GID: {endpoint.gid.hex('.')}",
        *describe_profile(endpoint.qos),
        f"Messages: {counters.samples} ({size_text(counters.bytes)})",
    ]
    if endpoint.kind != "publisher":
        bound = f" of {endpoint.qos.depth}" if endpoint.qos.history is History.KEEP_LAST else ""
        lines.append(f"Queue: {counters.queued}{bound}")
    lines.append(f"Dropped: {dropped_text(counters.dropped)}")
    if endpoint.kind != "publisher":
        lines.append(f"Expected: {counters.expected}")
    if advice:
        lines.append(f"Advice: {advice}")
    lines.append(f"Matches: {sum('route' in match for match in matches)}")
    for match in matches:
        how = f"route: {match['route']}" if "route" in match else f"no match: {match['reason']}"
        lines.append(f"  {match['node']} ({how})")
    return lines


def _matches(graph: Graph, endpoint: GraphEndpoint, describe: Describe) -> list[dict[str, str]]:
    """Every endpoint on the other side, with the route of the match or the reason why there is none.

    For a tap, only the publishers that it takes from: it is not meant for all publishers.
    """
    routes = {(match.publisher, match.subscription): match.route for match in graph.matches}
    found = []
    is_publisher = endpoint.kind == "publisher"
    for other in (
        graph.subscriptions_of(endpoint.topic) if is_publisher else graph.publishers_of(endpoint.topic)
    ):
        publisher, subscription = (endpoint, other) if is_publisher else (other, endpoint)
        route = routes.get((publisher.id, subscription.id))
        if route is None:
            if endpoint.kind == "tap":
                continue
            reason = kept_apart(publisher, subscription) or mismatch(publisher, subscription, describe)
            how = {"reason": reason or _other_reason(publisher, subscription)}
        else:
            how = {"route": route}
        found.append({"node": other.node.full_name, **how})
    return found


def _other_reason(publisher: GraphEndpoint, subscription: GraphEndpoint) -> str:
    """The reason for a missing match if types and QoS are compatible."""
    if publisher.node.origin is None or subscription.node.origin is None:
        return "unknown"
    return "both belong to other buses, and no bridge forwards between them here"


def _record(endpoint: GraphEndpoint, matches: list[dict[str, str]], advice: str) -> dict[str, Any]:
    from msgspec import to_builtins

    qos, counters = endpoint.qos, endpoint.statistics or EndpointStatistics()
    return {
        "node": endpoint.node.full_name,
        "pid": endpoint.node.pid,
        **origin_record(endpoint.node),
        "type": endpoint.type_name,
        "type_hash": endpoint.type_hash,
        "gid": endpoint.gid.hex("."),
        "qos": {name: to_builtins(getattr(qos, name)) for name in qos.__struct_fields__},
        "messages": counters.samples,
        "bytes": counters.bytes,
        "queued": counters.queued,
        "dropped": counters.dropped,
        **(
            {"expected": counters.expected, "most_missed": counters.most_missed}
            if endpoint.kind != "publisher"
            else {}
        ),
        **({"advice": advice} if advice else {}),
        "matches": matches,
    }
