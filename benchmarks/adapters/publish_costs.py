"""The program of check_cost.py: times the parts of `publish` and `take` for some messages, in rounds."""

import asyncio
from collections.abc import Callable
from time import monotonic_ns
from timeit import Timer
from typing import Any, NamedTuple

import msgspec

import bus
from benchmarks.work import text_of
from benchmarks.worker import Parent, options, run
from bus.msg.geometry_msgs import Quaternion, Twist, Vector3
from bus.msg.sensor_msgs import Image, Imu
from bus.msg.std_msgs import Header, String
from bus.types.support import type_support

_DEPTH = 1000


class Rounds(msgspec.Struct, frozen=True):
    """The approximate duration of each part of a round."""

    part_s: float


def messages() -> dict[str, msgspec.Struct]:
    """The messages to publish, filled with typical values."""
    header = Header(frame_id="base_link")
    return {
        "String of 64 B": String(data=text_of(64)),
        "Twist": Twist(linear=Vector3(x=0.5, y=0.0, z=0.0), angular=Vector3(x=0.0, y=0.0, z=-1.25)),
        "Imu": Imu(
            header=header,
            orientation=Quaternion(x=0.1, y=0.2, z=0.3, w=0.9),
            orientation_covariance=[0.01 * index for index in range(9)],
            angular_velocity=Vector3(x=0.01, y=0.02, z=0.03),
            linear_acceleration=Vector3(x=0.1, y=0.2, z=9.81),
        ),
        "Image of 1 MiB": Image(
            header=header, height=512, width=2048, encoding="mono8", step=2048, data=bytes(1 << 20)
        ),
    }


def per_call_ns(call: Callable[[Any], object], message: object, limit_s: float) -> float:
    """Mean time of a call, measured for about `limit_s`."""
    timer = Timer("call(message)", globals={"call": call, "message": message})
    once_s = min(timer.repeat(3, 1))
    number = max(1, min(100_000, int(limit_s / max(once_s, 1e-8))))
    return timer.timeit(number) / number * 1e9


async def publish_ns(pub: bus.Publisher[Any], message: msgspec.Struct, number: int, burst: int) -> float:
    """Mean time of `publish` over `number` calls, with `burst` calls in each turn of the event loop."""
    spent_ns = 0
    publish = pub.publish
    for _ in range(max(1, number // burst)):
        begin_ns = monotonic_ns()
        for _ in range(burst):
            publish(message)
        spent_ns += monotonic_ns() - begin_ns
        await pub.flush()
        await asyncio.sleep(0)
    return spent_ns / (max(1, number // burst) * burst)


async def take_ns(
    pub: bus.Publisher[Any], sub: bus.Subscription[Any], message: msgspec.Struct, number: int, burst: int
) -> float:
    """Mean time of `take` over about `number` messages; it takes each `burst` completely."""
    spent_ns = taken = 0
    take = sub.take
    while taken < number:
        for _ in range(burst):
            pub.publish(message)
        await pub.flush()
        await sub.receive()  # after this, all messages of the burst have arrived
        begin_ns = monotonic_ns()
        while take():
            taken += 1
        spent_ns += monotonic_ns() - begin_ns
    return spent_ns / taken


class Held(NamedTuple):
    """A message, a publisher without a match, and a publisher with a subscription in this process."""

    name: str
    message: msgspec.Struct
    alone: bus.Publisher[Any]
    heard: bus.Publisher[Any]
    sub: bus.Subscription[Any]


async def hold(node: bus.Node, index: int, name: str, message: msgspec.Struct) -> Held:
    kind: Any = type(message)
    alone = await node.create_publisher(kind, f"alone_{index}", _DEPTH)
    sub = await node.create_subscription(kind, f"heard_{index}", _DEPTH)
    heard = await node.create_publisher(kind, f"heard_{index}", _DEPTH)
    await heard.wait_for_subscriptions()
    return Held(name, message, alone, heard, sub)


async def main(parent: Parent) -> None:
    part_s = options(Rounds).part_s
    async with bus.Node("bench_costs") as node:
        held = [await hold(node, index, *one) for index, one in enumerate(messages().items())]
        parent.tell("ready")
        while True:
            await parent.wait_for("round")
            figures = {}
            for name, message, alone, heard, sub in held:
                support = type_support(type(message))
                check = per_call_ns(support.is_valid, message, part_s)
                encode = per_call_ns(support.encode, message, part_s)
                number = max(20, min(20_000, int(part_s * 1e9 / (check + encode) / 10)))
                burst = 8 if encode > 10_000 else 200
                figures[name] = {
                    "check_ns": check,
                    "encode_ns": encode,
                    "flood_ns": await publish_ns(alone, message, number, burst),
                    "single_ns": await publish_ns(alone, message, max(20, number // 10), 1),
                    "decode_ns": per_call_ns(support.decode, support.encode(message), part_s),
                    "take_ns": await take_ns(heard, sub, message, number, burst),
                }
            parent.tell("measured", figures=figures)


if __name__ == "__main__":
    run(main)
