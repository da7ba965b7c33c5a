"""bus_launch.launch.core: the context of a launch, and the normal form of texts and entities."""

import asyncio
import os
from pathlib import Path
from typing import Any

import pytest

from bus_launch.launch.core import (
    BaseEventHandler,
    Condition,
    Event,
    LaunchContext,
    LaunchDescriptionEntity,
    Substitution,
    SubstitutionFailure,
    TextSubstitution,
    ensure_argument_type,
    is_a_subclass,
    normalize_to_list_of_entities,
    normalize_to_list_of_substitutions,
    perform_substitutions,
    visit_all_entities_and_collect_futures,
)


class Entity(LaunchDescriptionEntity):
    """Records its visits, and returns its child entities."""

    def __init__(self, visited: list[Any], *below: LaunchDescriptionEntity, future: Any = None) -> None:
        self.visited, self.below, self.future = visited, below, future

    def visit(self, context: LaunchContext) -> Any:
        self.visited.append(self)
        return self.below

    def get_asyncio_future(self) -> Any:
        return self.future


def test_what_was_set_between_push_and_pop_is_gone(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OF_A_TEST", "before")
    context = LaunchContext()
    context.launch_configurations["a"] = "before"
    context.extend_locals({"a": "before"})
    context.extend_globals({"g": "global"})
    context._push_environment()
    context._push_launch_configurations()
    context._push_locals()
    os.environ["OF_A_TEST"], os.environ["ALSO_OF_A_TEST"] = "inside", "inside"
    context.launch_configurations.update(a="inside", b="inside")
    context.extend_locals({"a": "inside", "b": "inside"})
    assert context.get_locals_as_dict() == {"g": "global", "a": "inside", "b": "inside"}
    context._pop_locals()
    context._pop_launch_configurations()
    context._pop_environment()
    assert (os.environ["OF_A_TEST"], "ALSO_OF_A_TEST" in os.environ) == ("before", False)
    assert context.launch_configurations == {"a": "before"}
    assert (context.locals.a, context.locals.g) == ("before", "global")
    with pytest.raises(AttributeError, match=r"context\.locals does not contain attribute 'b'"):
        _ = context.locals.b
    for pop in (context._pop_locals, context._pop_launch_configurations, context._pop_environment):
        with pytest.raises(RuntimeError, match="stack unexpectedly empty"):
            pop()


def test_the_newest_handler_is_the_first_one() -> None:
    context = LaunchContext()
    handlers = [BaseEventHandler(matcher=lambda event: False) for _ in range(3)]
    context.register_event_handler(handlers[0])
    context.register_event_handler(handlers[1])
    context.register_event_handler(handlers[2], append=True)
    assert context._event_handlers == [handlers[1], handlers[0], handlers[2]]
    assert not context.would_handle_event(Event())
    context.register_event_handler(BaseEventHandler(matcher=lambda event: True))
    assert context.would_handle_event(Event())
    context.unregister_event_handler(handlers[0])
    with pytest.raises(ValueError, match="not in list"):
        context.unregister_event_handler(handlers[0])


async def test_a_completion_future_holds_the_launch_until_it_is_done() -> None:
    context = LaunchContext()
    future = asyncio.get_running_loop().create_future()
    context.add_completion_future(future)
    assert context._completion_futures == {future}
    future.set_result(None)
    await asyncio.sleep(0)
    assert context._completion_futures == set()
    assert context._event_queue.get_nowait() is None, "the launch is woken"


def test_texts_paths_and_substitutions_in_a_row_are_one_text() -> None:
    subs = normalize_to_list_of_substitutions(["a", Path("/b"), TextSubstitution(text="c")])
    assert perform_substitutions(LaunchContext(), subs) == "a/bc"
    assert [one.describe() for one in subs] == ["'a'", "'/b'", "'c'"]
    for wrong in (5, ["a", 5]):
        with pytest.raises(TypeError, match="Failed to normalize given item of type '<class 'int'>'"):
            normalize_to_list_of_substitutions(wrong)  # type: ignore[arg-type]
    with pytest.raises(TypeError, match="expected Text object"):
        TextSubstitution(text=5)  # type: ignore[arg-type]


def test_substitutions_that_need_each_other() -> None:
    class Round(Substitution):
        def perform(self, context: LaunchContext) -> str:
            return context.perform_substitution(self)

    with pytest.raises(SubstitutionFailure, match="go round in a circle, at a Round"):
        LaunchContext().perform_substitution(Round())


async def test_entities_are_visited_depth_first_and_what_is_not_done_is_collected() -> None:
    visited: list[Any] = []
    future = asyncio.get_running_loop().create_future()
    leaf, last = Entity(visited, future=future), Entity(visited)
    middle = Entity(visited, leaf)
    top = Entity(visited, middle, last)
    assert visit_all_entities_and_collect_futures(top, LaunchContext()) == [(leaf, future)]
    assert visited == [top, middle, leaf, last]
    nested: Any = [top, [middle, (leaf,)]]
    assert normalize_to_list_of_entities(nested) == [top, middle, leaf]
    assert normalize_to_list_of_entities(None) == []


def test_entities_may_not_be_nested_without_end() -> None:
    visited: list[Any] = []
    again = Entity(visited)
    again.below = (again,)
    context = LaunchContext()
    context.extend_locals({"current_launch_file_path": "/a.launch.py"})
    with pytest.raises(RuntimeError, match=r"more than 150 .*: does '/a.launch.py' include itself?"):
        visit_all_entities_and_collect_futures(again, context)
    assert len(visited) == 150
    done = Entity(visited)
    assert visit_all_entities_and_collect_futures(done, context) == [], "its depth is zero again"


def test_conditions_and_types_of_arguments() -> None:
    assert Condition(predicate=lambda context: True).evaluate(LaunchContext())
    with pytest.raises(NotImplementedError, match="Condition has no predicate"):
        Condition().evaluate(LaunchContext())
    ensure_argument_type("a", (str, int), "x")
    with pytest.raises(TypeError, match=r"Expected 'x' to F to be one of .'str', 'int'., but got '1.5'"):
        ensure_argument_type(1.5, [str, int], "x", "F")
    assert [is_a_subclass(one, Event) for one in (Event, Event(), 5, int)] == [True, True, False, False]
