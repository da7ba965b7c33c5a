"""The way round the square, without a bus."""

from bus_turtlesim.draw_square import Place, Square
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
