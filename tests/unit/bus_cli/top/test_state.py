"""The rows of `bus top`, and the chosen row, while the bus changes."""

from bus.graph import EndpointStatistics, Graph, GraphEndpoint, GraphNode
from bus.qos import QoSProfile
from bus_cli.top.columns import name_of
from bus_cli.top.state import State
from bus_web.model import Model

TALKER, TOOL = GraphNode(1, "talker", "/", 10), GraphNode(2, "_tool", "/", 20)
S = 1_000_000_000


def look(model: Model, *topics: str, seconds: int = 1) -> Model:
    """Each topic has a publisher. The later a topic is in the alphabet, the more its publisher sends."""
    ends = tuple(
        GraphEndpoint(
            ord(name[-1]),
            "publisher",
            TOOL if name.startswith("/_") else TALKER,
            name,
            f"x/msg/{name[-1].upper()}",
            "h",
            name.encode(),
            QoSProfile(),
            EndpointStatistics(samples=seconds * ord(name[-1]), at_ns=seconds * S),
        )
        for name in topics
    )
    model.take(Graph(1, 1, (TALKER, TOOL), ends, (), ()), seconds * S)
    return model


def state_of(*topics: str) -> State:
    state, model = State(), Model()
    for seconds in (1, 2):
        state.take(look(model, *topics, seconds=seconds))
    return state


def chosen(state: State) -> str:
    assert state.chosen is not None
    return name_of(state.chosen)


def shown(state: State) -> list[str]:
    return [name_of(row) for row in state.rows]


def test_nothing_is_there_yet() -> None:
    state = State()
    assert (state.index, state.chosen, state.endpoints, state.pairs, state.names, state.about) == (
        -1, None, [], [], {}, "",
    )  # fmt: skip
    assert state.sums == "looking for the bus"
    state.sort_by_next()
    state.toggle_nodes()
    assert state.rows == ()
    state.take(look(Model()))
    assert (state.index, state.chosen) == (-1, None)


def test_sorted_by_the_next_column_and_the_other_way_round() -> None:
    state = state_of("/a", "/b", "/c")
    assert (state.by, shown(state)) == ("topic", ["/a", "/b", "/c"])
    state.sort_by_next()
    state.sort_by_next()
    assert (state.by, shown(state)) == ("hz", ["/c", "/b", "/a"])
    state.reverse()
    assert (shown(state), state.notes) == (["/a", "/b", "/c"], ["reversed"])
    state.sort_by_next()
    assert (state.by, state.notes) == ("b/s", [])
    seen = {state.by}
    while state.by != "topic":
        state.sort_by_next()
        seen.add(state.by)
    assert seen | {"type", "hz"} == {*state.table.sort_keys}


def test_the_chosen_row_stays_chosen_wherever_it_goes() -> None:
    state, model = State(), Model()
    state.take(look(model, "/c"))
    state.take(look(model, "/b", "/c", "/d"))
    assert chosen(state) == "/b"  # the first row, as the user has chosen none
    state.choose(1)
    state.take(look(model, "/a", "/b", "/c", "/d"))
    assert (state.index, chosen(state)) == (2, "/c")
    state.reverse()
    assert (state.index, chosen(state)) == (1, "/c")
    state.take(look(model, "/a", "/b"))
    assert (state.index, chosen(state)) == (1, "/a")
    state.take(look(model, "/a", "/b", "/c"))
    assert chosen(state) == "/c"


def test_only_rows_with_a_text() -> None:
    state = state_of("/arm/a", "/arm/b", "/leg/c")
    for text, names in (("ARM", ["/arm/a", "/arm/b"]), ("x/msg/c", ["/leg/c"]), ("nothing", []), ("", None)):
        state.set_filter(text)
        assert shown(state) == (["/arm/a", "/arm/b", "/leg/c"] if names is None else names)
        assert state.notes == ([f"only with {text!r}"] if text else [])
    assert state.sums.startswith("1 node, 3 topics")


def test_hidden_ones() -> None:
    state = state_of("/a", "/_hidden/b")
    assert shown(state) == ["/a"]
    state.toggle_hidden()
    assert (shown(state), state.notes) == (["/_hidden/b", "/a"], ["hidden ones too"])
    state.toggle_nodes()
    assert shown(state) == ["/_tool", "/talker"]
    state.toggle_hidden()
    assert shown(state) == ["/talker"]


def test_nodes() -> None:
    state = state_of("/a", "/b")
    state.sort_by_next()
    assert state.by == "type"
    state.toggle_nodes()
    assert (state.by, shown(state), state.about) == ("node", ["/talker"], "/talker  process 10")
    assert [one.topic for one in state.endpoints] == ["/a", "/b"]
    assert (state.pairs, set(state.names.values())) == ([], {"/talker"})
    state.set_filter("10")
    assert shown(state) == ["/talker"]
    state.toggle_nodes()
    assert (state.by, shown(state)) == ("topic", [])


def test_what_the_user_should_know() -> None:
    state = state_of("/a")
    state.is_away = state.is_paused = True
    assert state.notes == ["busd does not answer; these are the last figures", "paused"]
    assert state.about == "/a  x/msg/A"
