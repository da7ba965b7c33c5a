"""The pages agree with the code: messages, fields, layers, presets, texts, limits, links."""

import json
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, get_args

import msgspec
import pytest

from bus import events, qos
from bus.delivery.match import FEEDS, GATES, FeedEvent, GateEvent
from bus.msg import PACKAGES
from bus.msg.std_msgs import String
from bus.types.support import type_support
from bus.vocabulary import DropReason
from bus.wire import layout, messages, records, session
from bus.wire.runs import Account, Run, RunQueue
from bus.wire.source_time import source_head
from bus_bridge.core import continuity
from bus_bridge.core.continuity import ContinuityEvent
from bus_cli.main import COMMANDS, VERBS_WITH_VERBS, make_parser, own_words
from busd.core.match import TRANSITIONS, MatchEvent
from busd.server import life
from busd.server.life import LifeEvent
from feeding import frame_record
from rows import for_each

ROOT = Path(__file__).parents[2]
DOCS = ROOT / "docs"
OURS = (
    "api",
    "protocol",
    "architecture",
    "lesson",
    "patterns",
    "qos",
    "operation",
    "reliability",
    "security",
    "README",
    "conformance",
)
PAGES = {name: (DOCS / f"{name}.md").read_text() for name in OURS}
README = (ROOT / "README.md").read_text()
ALL = {"../README": README, **PAGES}

CODE = re.compile(r"`([^`\n]+)`")
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)


def fences(text: str) -> list[str]:
    return [block for _, block in FENCE.findall(text)]


def words(text: str) -> str:
    """The text with single spaces only, because lines may break anywhere."""
    return " ".join(text.split())


def tables(text: str) -> Iterator[tuple[list[str], list[list[str]]]]:
    """Head and rows of each table. Cells have no backticks and stars."""
    for block in re.findall(r"(?:^\|.*\|\n)+", text, re.MULTILINE):
        head, _, *rows = [
            [re.sub(r"^(\*\*|`)(.*)\1$", r"\2", cell.strip()) for cell in line.split("|")[1:-1]]
            for line in block.splitlines()
        ]
        yield head, rows


def rows_of(text: str, *head: str) -> list[list[str]]:
    """The rows of all tables whose heads begin with `head`."""
    found = [rows for title, rows in tables(text) if tuple(title[: len(head)]) == head]
    assert found, f"there is no table {head}"
    return [row for rows in found for row in rows]


def as_rows(transitions: Mapping[Any, Mapping[Any, Any]], events: Iterable[Any]) -> list[list[str]]:
    """A table of states, as on the pages: a row for each state, with the next state for each event."""
    return [
        [state.value, *(row[event].value if event in row else "" for event in events)]
        for state, row in transitions.items()
    ]


def section(text: str, title: str) -> str:
    level = len(title) - len(title.lstrip("#"))
    _, found, rest = text.partition(f"\n{title}\n")
    assert found, f"there is no section {title}"
    return re.split(rf"^#{{2,{level}}} ", rest, maxsplit=1, flags=re.MULTILINE)[0]


def drop_reasons() -> set[str]:
    """The reasons with which busd and the library count lost messages."""
    sources = [path.read_text() for root in ("busd", "clients/bus") for path in (ROOT / root).rglob("*.py")]
    return {DropReason[name] for name in re.findall(r"\bDropReason\.([A-Z_]+)", "".join(sources))}


class TestProtocol:
    text = PAGES["protocol"]

    def test_pictures_are_those_of_the_code(self) -> None:
        blocks = fences(self.text)
        for module, begin in ((layout, "frame "), (session, "state ")):
            lines = (module.__doc__ or "").split("\n")
            start = next(at for at, line in enumerate(lines) if line.startswith(f"    {begin}"))
            stop = next(
                at
                for at, line in enumerate([*lines, "."])
                if at > start and line and not line.startswith("    ")
            )
            picture = "\n".join(line.removeprefix("    ") for line in lines[start:stop]).strip()
            assert picture in [block.strip() for block in blocks]

    @for_each("title", ["Both ways", "From a client", "From busd"])
    def test_messages_by_direction(self, title: str) -> None:
        client, broker = set(get_args(messages.FromClient)), set(get_args(messages.FromBroker))
        expected = {
            "Both ways": client & broker,
            "From a client": client - broker,
            "From busd": broker - client,
        }[title]
        rows = rows_of(section(self.text, f"### {title}"), "message", "tag", "fields")
        assert {row[0] for row in rows} == {cls.__name__ for cls in expected}

    def test_every_message_is_described(self) -> None:
        described = {row[0] for row in rows_of(self.text, "message", "tag", "fields")}
        defined = {
            name
            for name, value in vars(messages).items()
            if isinstance(value, type) and issubclass(value, messages.Message)
        }
        assert described == defined - {"Message"}

    def test_tags_and_fields(self) -> None:
        for name, tag, fields, meaning in rows_of(self.text, "message", "tag", "fields"):
            cls = getattr(messages, name)
            assert tag == cls.__struct_config__.tag
            assert re.findall(r"`(\w+)`", f"`{fields}`") == list(cls.__struct_fields__), name
            assert meaning, name

    def test_records(self) -> None:
        defined = {
            value
            for value in vars(records).values()
            if isinstance(value, type)
            and issubclass(value, msgspec.Struct)
            and value.__module__ == records.__name__
        }
        described = {row[0]: row[1] for row in rows_of(self.text, "record", "fields")}
        assert set(described) == {cls.__name__ for cls in defined}
        for cls in defined:
            fields = re.findall(r"`(\w+)`", f"`{described[cls.__name__]}`")
            assert fields == list(cls.__struct_fields__)

    def test_kinds_flags_and_sizes(self) -> None:
        kinds = {row[0]: int(row[1]) for row in rows_of(self.text, "kind", "number")}
        assert kinds == {"control": layout.CONTROL, "data": layout.DATA}
        text = words(self.text)
        assert f"This is version {layout.PROTOCOL_VERSION}." in text
        assert f"in a data frame {layout.REPLAY} = *replay*" in text
        assert f" {layout.RESUMED} = *resumed*" in text
        control = layout.FRAME_HEAD_BYTES - layout.LENGTH_BYTES
        data = layout.DATA_HEAD_BYTES - layout.LENGTH_BYTES
        assert f"{control} and the body in a control frame, {data} and the records in a data frame" in text

    def test_fixed_limits(self) -> None:
        values = {
            row[0]: row[1] for row in rows_of(section(self.text, "## Errors and limits"), "limit", "value")
        }
        assert values["control message to busd"] == f"{layout.MAX_CONTROL_BYTES >> 20} MiB"
        long_ones = next(
            value for name, value in values.items() if name.startswith("control message to a client")
        )
        assert long_ones == f"{layout.MAX_SNAPSHOT_BYTES >> 20} MiB"
        assert f"{layout.RUN_BYTES >> 10} KiB" in values["run"]
        assert f"{layout.MAX_MESSAGE_BYTES >> 30} GiB" in values["encoded message"]
        assert f"{session.MAX_BATCHES} batches" in values["descriptors"]
        assert values["sequence numbers and counters"] == f"2^{layout.MAX_COUNT.bit_length()} - 1"

    def test_bytes(self) -> None:
        dumps = [bytes.fromhex(block) for block in fences(self.text) if re.fullmatch(r"[0-9a-f \n]+", block)]
        support = type_support(String)
        records = [
            frame_record(support.encode(String(data="hi")), 1_000_000_000),
            frame_record(support.encode(String(data="ho")), 1_000_000_500),
        ]
        queue = RunQueue(0, Account(1 << 20), endpoint=7)
        queue.append(Run(0, 3, 5, 2, b"".join(records)))
        run_head, run_body = queue.pop_frame()
        hello = messages.Hello(version=layout.PROTOCOL_VERSION, pid=4711, program="talker.py")
        declared = messages.DeclareType(
            type_name=support.name, type_hash=support.hash, schema=support.description
        )
        assert dumps == [
            source_head(1_700_000_000 * 10**9) + support.encode(String(data="hi")),
            messages.encode_frame(hello),
            messages.encode_frame(declared),
            bytes(run_head) + bytes(run_body),
        ]

    def test_the_type_of_a_string(self) -> None:
        support = type_support(String)
        (schema,) = [json.loads(block) for block in fences(self.text) if block.startswith('{"root"')]
        assert schema == msgspec.msgpack.decode(support.description)
        assert support.hash in self.text


class TestArchitecture:
    text = PAGES["architecture"]

    @pytest.mark.parametrize("package", ["bus", "busd"])
    def test_layers_are_those_that_the_linter_holds(self, package: str) -> None:
        project = tomllib.loads((ROOT / "pyproject.toml").read_text())
        contracts = project["tool"]["importlinter"]["contracts"]
        layers = next(one["layers"] for one in contracts if one.get("containers") == [package])
        assert "\n".join(layers) in [block.strip() for block in fences(self.text)]

    def test_places_of_drops(self) -> None:
        for reason, _, where, _ in rows_of(section(self.text, "## Drops"), "reason", "counted by"):
            for path in re.findall(r"[\w/]+\.py", where):
                assert f"DropReason.{reason.upper()}" in (ROOT / path).read_text(), (reason, path)

    def test_the_states_of_a_match(self) -> None:
        drawn = rows_of(self.text, "state", *[event.value for event in MatchEvent])
        assert drawn == as_rows(TRANSITIONS, MatchEvent)

    def test_the_states_of_a_way_over_a_bridge(self) -> None:
        drawn = rows_of(self.text, "next number", *[event.value for event in ContinuityEvent])
        assert drawn == as_rows(continuity.TRANSITIONS, ContinuityEvent)

    def test_the_states_of_busd(self) -> None:
        drawn = rows_of(self.text, "state", *[event.value for event in LifeEvent])
        assert drawn == as_rows(life.TRANSITIONS, LifeEvent)

    def test_the_core_is_described(self) -> None:
        described = {row[0] for row in rows_of(section(self.text, "## The broker"), "module", "subject")}
        present = {f"busd/core/{path.name}" for path in (ROOT / "busd" / "core").glob("*.py")}
        assert described == present - {f"busd/core/{name}.py" for name in ("__init__", "broker", "effects")}


class TestRing:
    text = (DOCS / "ring.md").read_text()

    def test_the_states_of_a_gate(self) -> None:
        assert rows_of(self.text, "gate", *[event.value for event in GateEvent]) == as_rows(GATES, GateEvent)

    def test_the_states_of_a_feed(self) -> None:
        assert rows_of(self.text, "feed", *[event.value for event in FeedEvent]) == as_rows(FEEDS, FeedEvent)


class TestQoS:
    text = PAGES["qos"]

    def test_policies_and_defaults(self) -> None:
        plain = msgspec.structs.asdict(qos.QoSProfile())
        rows = {row[0]: row for row in rows_of(self.text, "field", "values", "default")}
        assert {name: row[2] for name, row in rows.items()} == {
            name: str(value) for name, value in plain.items()
        }
        for name, row in rows.items():
            if isinstance(plain[name], str):
                assert set(CODE.findall(f"`{row[1]}`")) == {member.value for member in type(plain[name])}

    def test_presets(self) -> None:
        columns = ("depth", "history", "reliability", "durability", "lifespan")
        rows = rows_of(self.text, "preset", *columns)
        described = {row[0]: tuple(row[1:]) for row in rows}
        assert described == {
            name: tuple(str(getattr(profile, column)) for column in columns)
            for name, profile in qos.PRESETS.items()
        }
        for profile in qos.PRESETS.values():
            assert (profile.deadline, profile.liveliness_lease_duration) == (None, None)

    def test_the_matrix(self) -> None:
        """The code must agree with every row, and the rows must have every text of the code."""
        told: set[str] = set()
        for policy, offered, requested, match, text in rows_of(self.text, "policy", "publisher offers"):
            if policy == "history, depth, lifespan":
                continue
            for offer, request in _profiles(policy, offered, requested):
                found = qos.check_compatible(offer, request)
                assert (not found) == (match == "yes"), (policy, offered, requested)
                assert [one.text for one in found] == ([text] if text else [])
                told.update(one.text for one in found)
        known = {value.text for value in vars(qos).values() if isinstance(value, qos.Incompatibility)}
        assert told == known

    def test_events(self) -> None:
        rows = rows_of(self.text, "event", "publisher", "subscription")
        for at, cls in ((1, events.PublisherEvents), (2, events.SubscriptionEvents)):
            assert [row[0] for row in rows if row[at] == "yes"] == [*cls.__struct_fields__]


def _profiles(policy: str, offered: str, requested: str) -> Iterator[tuple[qos.QoSProfile, qos.QoSProfile]]:
    durations = {"deadline": "deadline", "lease": "liveliness_lease_duration"}
    if policy not in durations:
        enum = type(getattr(qos.QoSProfile(), policy))
        for offer in enum if offered == "any" else [offered]:
            for request in enum if requested == "any" else [requested]:
                yield _profile(policy, offer), _profile(policy, request)
        return
    values: dict[str, list[tuple[float | None, float | None]]] = {
        "any None": [(None, None), (1.0, None)],
        "None s": [(None, 1.0)],
        "p s >= p": [(1.0, 1.0), (1.0, 2.0)],
        "p s < p": [(1.0, 0.5)],
    }
    name = durations[policy]
    for offer_s, request_s in values[f"{offered} {requested}"]:
        yield _profile(name, offer_s), _profile(name, request_s)


def _profile(field: str, value: Any) -> qos.QoSProfile:
    fields: dict[str, Any] = {field: value}
    return qos.QoSProfile(**fields)


@pytest.mark.parametrize("page", ["qos", "architecture"])
def test_every_drop_reason_is_explained(page: str) -> None:
    reasons = drop_reasons()
    assert "replaced" in reasons
    assert {row[0] for row in rows_of(PAGES[page], "reason")} == reasons


@for_each("name", ALL)
def test_commands_exist(name: str) -> None:
    """Every `bus ...` on a page can be parsed with its options, except `bus run`."""
    shown = [text.removeprefix("$ ") for text in CODE.findall(FENCE.sub("", ALL[name]))]
    shown += [line[2:] for block in fences(ALL[name]) for line in block.splitlines() if line.startswith("$ ")]
    for text in shown:
        arguments = [part.strip('"') for part in re.findall(r'"[^"]*"|\S+', text)]
        if arguments[0] != "bus" or arguments[1:2] in (["run"], []):
            continue
        words, _ = own_words(arguments[1:])
        command, *verb = words
        verbs = COMMANDS[command][1]
        is_verb = command in VERBS_WITH_VERBS and (not verb or verb[0].startswith("-"))
        assert not verbs or is_verb or verb[0] in verbs, text
        if len(words) > 2 or not verbs or verb[:1] == ["--conformance"]:
            make_parser(words).parse_args(words)


def test_make_targets_exist() -> None:
    targets = set(re.findall(r"^([a-z0-9-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    for name, text in ALL.items():
        for target in re.findall(r"(?:`|\n|\$ )make ([a-z0-9-]+)", text):
            assert target in targets, (name, target)


@pytest.mark.parametrize("example", ["examples/talker.py", "examples/listener.py"])
def test_the_readme_shows_the_examples_as_they_are(example: str) -> None:
    blocks = [block for language, block in FENCE.findall(README) if language == "python"]
    assert (ROOT / example).read_text() in blocks


def test_the_readme_names_the_message_packages() -> None:
    for package in set(PACKAGES) - {"rcl_interfaces"}:
        assert f"`{package}`" in README


def test_speed_has_its_link() -> None:
    """Numbers have a meaning only with the machine and the method."""
    assert "benchmarks/README.md" in section(README, "## Speed")
