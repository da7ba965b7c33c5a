"""Turtles and their world, without a bus."""

from math import inf, nan, pi

import pytest

from bus_turtlesim.world import PERIOD_S, SIZE, Step, Turtle, World

PERIOD_NS = round(PERIOD_S * 1e9)
PEN = (0xB3, 0xB8, 0xFF)


def moved(turtle: Turtle, steps: int, since_ns: int = 0) -> list[Step]:
    return [turtle.step(since_ns + step * PERIOD_NS) for step in range(1, steps + 1)]


def turtle1(x: float = 5.0, y: float = 5.0, theta: float = 0.0) -> tuple[World, Turtle]:
    world = World()
    return world, world.turtles[world.spawn(x, y, theta, 0)]


def test_a_velocity_lasts_a_second() -> None:
    _, turtle = turtle1()
    turtle.command(1.0, 0.0, 0.0, 0)
    moved(turtle, 100)
    assert turtle.x == pytest.approx(5.0 + 62 * PERIOD_S)
    assert turtle.y == 5.0
    assert turtle.speed == 0.0


def test_it_goes_where_it_looks_and_to_its_left() -> None:
    _, turtle = turtle1(theta=pi / 2)
    turtle.command(1.0, 2.0, 0.0, 0)
    moved(turtle, 1)
    assert (turtle.x, turtle.y) == pytest.approx((5.0 - 2 * PERIOD_S, 5.0 + PERIOD_S))


def test_headings_stay_between_minus_pi_and_pi() -> None:
    _, turtle = turtle1(theta=pi - 0.001)
    turtle.command(0.0, 0.0, 1.0, 0)
    moved(turtle, 1)
    assert turtle.theta == pytest.approx(PERIOD_S - 0.001 - pi)


def test_walls_hold_it() -> None:
    _, turtle = turtle1(x=SIZE - 0.01, y=SIZE)
    turtle.command(1.0, 0.0, 0.0, 0)
    (step,) = moved(turtle, 1)
    assert step.wall == pytest.approx((SIZE + 0.006, 0.0))
    assert (turtle.x, turtle.y) == (SIZE, SIZE)
    turtle.teleport(-1e30, 1e30, 0.0)
    (step,) = moved(turtle, 1, 2_000_000_000)
    assert step.wall == (-1e30, 0.0)
    assert (turtle.x, turtle.y) == (0.0, SIZE)
    assert moved(turtle, 1, 3_000_000_000)[0].wall is None


@pytest.mark.parametrize(("theta", "turn"), [(1.0, 1.0), (-1.0, -1.0), (1.0 + 4 * pi, 1.0)])
def test_a_rotation_goes_the_short_way(theta: float, turn: float) -> None:
    _, turtle = turtle1()
    turtle.rotate(theta)
    first, *_ = steps = moved(turtle, 200)
    assert first.rotation is not None
    assert (first.rotation.remaining, first.rotation.is_done) == (pytest.approx(turn), False)
    ended = [step.rotation for step in steps if step.rotation is not None and step.rotation.is_done]
    assert len(ended) == 1
    assert ended[0].delta == pytest.approx(-turn, abs=0.02) == turtle.delta
    assert turtle.velocity == (0.0, 0.0, 0.0)
    assert steps[-1].rotation is None


def test_a_command_ends_a_rotation() -> None:
    _, turtle = turtle1()
    turtle.rotate(1.0)
    moved(turtle, 1)
    turtle.command(0.0, 0.0, 0.0, PERIOD_NS)
    assert moved(turtle, 1, PERIOD_NS)[0].rotation is None


def test_what_it_draws() -> None:
    world, turtle = turtle1()
    assert turtle.colour() is None
    turtle.jump(1.0, pi / 2)
    assert (turtle.x, turtle.y) == pytest.approx((5.0, 6.0))
    assert turtle.colour() == PEN
    turtle.pen = turtle.pen._replace(is_on=False)
    turtle.teleport(2.0, 2.0, 0.0)
    assert turtle.colour() is None
    turtle.pen = turtle.pen._replace(is_on=True, colour=(1, 2, 3))
    turtle.command(1.0, 0.0, 0.0, 0)
    moved(turtle, 1)
    assert turtle.colour() == (1, 2, 3)
    world.canvas.clear()
    assert turtle.colour() is None


def test_names() -> None:
    world, _ = turtle1()
    assert world.spawn(1.0, 1.0, 0.0, 0, "turtle2") == "turtle2"
    assert world.spawn(1.0, 1.0, 0.0, 0) == "turtle3"
    with pytest.raises(ValueError, match=r"A turtle named \[turtle3\] already exists"):
        world.spawn(1.0, 1.0, 0.0, 0, "turtle3")
    world.kill("turtle2")
    assert list(world.turtles) == ["turtle1", "turtle3"]
    with pytest.raises(ValueError, match=r"Tried to kill turtle \[turtle2\], which does not exist"):
        world.kill("turtle2")
    world.reset()
    assert world.turtles == {}
    assert world.spawn(1.0, 1.0, 0.0, 0) == "turtle1"


@pytest.mark.parametrize("number", [nan, inf])
def test_no_turtle_is_nowhere(number: float) -> None:
    with pytest.raises(ValueError, match="Can't spawn"):
        World().spawn(0.0, number, 0.0, 0)


def test_there_are_so_many_at_most() -> None:
    world = World()
    for _ in range(100):
        world.spawn(1.0, 1.0, 0.0, 0)
    with pytest.raises(ValueError, match="There are 100 turtles already"):
        world.spawn(1.0, 1.0, 0.0, 0)
