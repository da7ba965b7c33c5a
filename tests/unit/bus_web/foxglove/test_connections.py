"""The connections of the graph, as a client receives them."""

from bus.graph import Graph, GraphEndpoint, GraphNode
from bus.qos import QoSProfile
from bus_web.foxglove.connections import ConnectionGraph

NODES = [GraphNode(number, name, "/", 10 + number) for number, name in enumerate(("a", "b", "_bus_web_1"), 1)]
STRING = "std_msgs/msg/String"


def end(kind: str, node: int, topic: str) -> GraphEndpoint:
    return GraphEndpoint(
        hash((kind, node, topic)), kind, NODES[node], topic, STRING, "h", bytes(16), QoSProfile(1)
    )


def graph(*ends: GraphEndpoint) -> Graph:
    publishers = tuple(one for one in ends if one.kind == "publisher")
    return Graph(1, 1, tuple(NODES), publishers, tuple(one for one in ends if one.kind != "publisher"), ())


def test_who_is_connected() -> None:
    connections = ConnectionGraph()
    first = graph(
        end("publisher", 0, "/x"),
        end("subscription", 1, "/x"),
        end("subscription", 2, "/x"),
        end("subscription", 1, "/add/_request"),
        end("publisher", 1, "/add/_reply"),
    )
    assert connections.update(first) == {
        "publishedTopics": [{"name": "/x", "publisherIds": ["/a"]}],
        "subscribedTopics": [{"name": "/x", "subscriberIds": ["/b"]}],
        "advertisedServices": [{"name": "/add", "providerIds": ["/b"]}],
        "removedTopics": [],
        "removedServices": [],
    }
    assert connections.update(first) is None
    assert connections.update(graph(end("subscription", 1, "/x"))) == {
        "publishedTopics": [{"name": "/x", "publisherIds": []}],
        "subscribedTopics": [],
        "advertisedServices": [],
        "removedTopics": [],
        "removedServices": ["/add"],
    }
    last = connections.update(graph())
    assert last is not None
    assert (last["removedTopics"], last["publishedTopics"], last["subscribedTopics"]) == (["/x"], [], [])
