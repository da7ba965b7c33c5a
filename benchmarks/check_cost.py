"""The parts of `publish` and `take`: the check of types, encoding and decoding, and the whole call."""

import msgspec

from benchmarks.adapters.publish_costs import Rounds, messages
from benchmarks.cases import Figures, Outcome
from benchmarks.harness import START_S, Failure, Group
from benchmarks.plan import Plan
from benchmarks.report import Column, Row, Section, compare

NAME = "check_cost"
_LIMIT_S = 60.0
_PROGRAM = "benchmarks.adapters.publish_costs"
_COLUMNS = [
    Column("check_ns", "ns: type check", "lower"),
    Column("encode_ns", "encode", "lower"),
    Column("flood_ns", "publish, in a flood", "lower"),
    Column("single_ns", "publish, one a turn", "lower"),
    Column("decode_ns", "decode", "lower"),
    Column("take_ns", "take", "lower"),
]
_NOTES = [
    "check and encode are parts of publish; a flood is 200 messages (8 images) in a turn of the event loop, "
    "of which runs are made; one a turn also pays for the system call that sends it",
    "publish: nobody hears it; decode is a part of take, which is called until nothing is left of a burst "
    "and gives the message with its info",
]


def run(plan: Plan) -> Section:
    """Measure each message; each round measures all of them in turn."""
    outcomes = {name: Outcome(name, series=name) for name in messages()}
    try:
        with Group() as group:
            group.start_busd()
            rounds = Rounds(part_s=plan.choose(20, 50) / 1000)
            program = group.start_python("costs", "-m", _PROGRAM, msgspec.json.encode(rounds).decode())
            group.expect(program, "ready", within_s=START_S)
            for number in range(plan.repetitions):
                plan.tell(f"check_cost {number + 1} of {plan.repetitions}")
                program.send("round")
                event = group.expect(program, "measured", within_s=_LIMIT_S)
                for name, figures in msgspec.convert(event["figures"], dict[str, Figures]).items():
                    outcomes[name].repetitions.append(figures)
    except Failure as error:
        for outcome in outcomes.values():
            outcome.failure = str(error)
    comparisons = []
    for name, outcome in outcomes.items():
        shares = [one["check_ns"] / one["flood_ns"] for one in outcome.repetitions]
        comparisons += compare(f"{name}: check as a part of publish in a flood", shares)
    rows = [Row.of(outcome) for outcome in outcomes.values()]
    return Section(NAME, "Parts: what publish and take are made of", _COLUMNS, rows, comparisons, _NOTES)
