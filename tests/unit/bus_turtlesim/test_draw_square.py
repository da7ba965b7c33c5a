"""The way round the square, without a bus."""

from math import inf, nan

from bus_turtlesim.draw_square import DrawSquare, Place, Square
from bus_turtlesim.messages import Pose
from bus_turtlesim.world import PERIOD_S, World


def test_a_turtle_comes_round() -> None:
    world = World()
    turtle = world.turtles[world.spawn(5.0, 5.0, 0.0, 0)]
    square, said = Square(), list[str]()
    corners = []
    for step in range(3000):
        is_still = turtle.velocity == (0.0, 0.0, 0.0)
        forward, turn, lines = square.next(Place(turtle.x, turtle.y, turtle.theta), is_still)
        said += lines
        if "Reached goal" in lines:
            corners.append((round(turtle.x), round(turtle.y)))
        now_ns = round(step * PERIOD_S * 1e9)
        turtle.command(forward, 0.0, turn, now_ns)
        turtle.step(now_ns)
    assert corners[:8] == [(7, 5), (7, 5), (7, 7), (7, 7), (5, 7), (5, 7), (5, 5), (5, 5)]
    assert said[:2] == ["New goal [7.000000 5.000000, 0.000000]", "Reached goal"]


def test_a_pose_that_is_not_finite_is_ignored() -> None:
    node = object.__new__(DrawSquare)
    node._pose = usual = Pose(x=1.0)
    for pose in (Pose(theta=inf), Pose(x=nan), Pose(y=-inf)):
        node._on_pose(pose)
    assert node._pose is usual
