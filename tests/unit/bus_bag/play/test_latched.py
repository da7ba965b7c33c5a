"""The latched state at a moment, and repetitions in a bag of several files."""

from bus_bag.play.latched import Identity, LatchedState


def test_the_last_of_each_topic_are_kept_in_order() -> None:
    state: LatchedState[str] = LatchedState({"/tf_static": 2, "/map": 1})
    said = [
        ("/tf_static", b"a"),
        ("/map", b"old"),
        ("/tf_static", b"b"),
        ("/tf_static", b"c"),
        ("/map", b"new"),
    ]
    for number, (topic, data) in enumerate(said):
        assert state.add(topic, Identity(100 + number, number, data), data.decode())
    assert list(state) == ["b", "c", "new"]


def test_what_comes_again_is_told() -> None:
    state: LatchedState[int] = LatchedState({"/map": 2})
    first, second = Identity(1, 1, b"a"), Identity(2, 2, b"b")
    assert state.add("/map", first, 1) and state.add("/map", second, 2)
    assert not state.add("/map", first, 3) and not state.add("/map", second, 4)
    assert list(state) == [1, 2]
    assert state.add("/map", Identity(3, 3, b"c"), 5) and state.add("/map", first, 6)


def test_files_without_numbers_repeat_what_has_the_same_content() -> None:
    state: LatchedState[int] = LatchedState({"/map": 2})
    assert state.add("/map", Identity(1, 0, b"a"), 1) and state.add("/map", Identity(1, 0, b"b"), 2)
    assert not state.add("/map", Identity(1, 0, b"a"), 3)
