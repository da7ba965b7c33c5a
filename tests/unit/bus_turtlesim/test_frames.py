"""The parts of turtles' drawings that a page receives."""

from bus_turtlesim.canvas import SIDE_PX, Square
from bus_turtlesim.frames import Frames, Pictures, message
from bus_turtlesim.world import World

RED = (255, 0, 16)


def square(number: int) -> Square:
    return (number, 0, number + 1, 1, RED)


def test_each_is_sent_what_it_has_not_had() -> None:
    frames = Frames()
    assert (frames.newest, frames.since(0)) == (0, (False, []))
    frames.add([square(1)], is_cleared=False)
    frames.add([square(2), square(3)], is_cleared=False)
    assert frames.newest == 2
    assert frames.since(0) == (False, [square(1), square(2), square(3)])
    assert frames.since(1) == (False, [square(2), square(3)])
    assert frames.since(2) == (False, [])


def test_what_was_cleared_is_not_sent() -> None:
    frames = Frames()
    frames.add([square(1)], is_cleared=False)
    frames.add([square(2)], is_cleared=True)
    frames.add([square(3)], is_cleared=False)
    assert frames.since(0) == (True, [square(2), square(3)])
    assert frames.since(2) == (False, [square(3)])


def test_who_is_too_late_needs_the_whole_picture() -> None:
    frames = Frames()
    for number in range(1000):
        frames.add([square(number)], is_cleared=False)
    assert frames.since(0) is None
    assert frames.since(998) == (False, [square(998), square(999)])


def test_who_misses_too_much_needs_the_whole_picture() -> None:
    """This happens if turtles are teleported from wall to wall many times in one step."""
    frames = Frames()
    for _ in range(3):
        frames.add([square(1)] * 4000, is_cleared=False)
    assert frames.since(0) is None
    assert frames.since(1) == (False, [square(1)] * 8000)
    frames.add([square(1)] * 10_001, is_cleared=False)
    assert frames.since(3) is None
    assert frames.since(4) == (False, [])
    frames.add([square(2)], is_cleared=False)
    assert frames.since(4) == (False, [square(2)])


def test_a_turtle_keeps_its_picture() -> None:
    world, pictures = World(), Pictures()
    for _ in range(3):
        world.spawn(1.0, 2.0, 0.5, 0)
    first = pictures.update(world.turtles.items())
    assert [(one.name, one.picture) for one in first] == [("turtle1", 0), ("turtle2", 1), ("turtle3", 2)]
    assert first[0][1:4] == (1.0, 2.0, 0.5)
    world.kill("turtle1")
    world.spawn(1.0, 2.0, 0.5, 0, "other")
    assert [one.picture for one in pictures.update(world.turtles.items())] == [1, 2, 3]


def test_a_message() -> None:
    world = World()
    world.spawn(1.0, 2.0, 0.5, 0)
    seen = Pictures().update(world.turtles.items())
    assert message(seen, (0x45, 0x56, 0xFF), [square(7)], is_cleared=True) == {
        "turtles": [{"name": "turtle1", "x": 1.0, "y": 2.0, "theta": 0.5, "picture": 0}],
        "background": "#4556ff",
        "cleared": True,
        "squares": [[7, 0, 8, 1, "#ff0010"]],
    }


def test_the_whole_picture() -> None:
    world = World()
    turtle = world.turtles[world.spawn(5.0, 5.0, 0.0, 0)]
    assert world.canvas.picture() == bytes(SIDE_PX * SIDE_PX * 4)
    turtle.jump(1.0, 0.0)
    picture = world.canvas.picture()
    painted = [at for at in range(3, len(picture), 4) if picture[at]]
    assert {picture[at - 3 : at + 1] for at in painted} == {bytes((0xB3, 0xB8, 0xFF, 0xFF))}
    assert len(painted) > 45
