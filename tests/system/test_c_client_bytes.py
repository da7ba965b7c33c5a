"""The C client's encoding, byte for byte: golden frames, and the message types that busd has."""

import json
import random
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import msgspec
import pytest

import bus
import c_programs
from bus.types.classes import service_class
from bus.types.definitions import find_message, names
from bus.types.support import find_type
from bus_cli.interface.c import header_of
from bus_cli.interface.c_fields import c_name
from daily_types import daily_part
from effort import is_nightly

pytestmark = pytest.mark.landing

FRAMES = json.loads((c_programs.ROOT / "docs" / "assets" / "frames.json").read_text())
HEAD_BYTES = 8
ROUNDS = 3
"""Messages of each type: with defaults, then with random values."""

READ = """
static int take_{name}(const unsigned char *bytes, size_t size, busd_out *out)
{{
    {name} m;
    busd_arena arena = {{}};
    busd_message taken = {{}};
    taken.data = bytes;
    taken.size = size;
    {name}__init(&m);
    const int status = size == 0 ? 0 : {name}__decode(&taken, &m, &arena);
    const size_t counted = {name}__size(&m);
    {name}__put(out, &m);
    busd_arena_free(&arena);
    return status != 0 ? status : out->size == counted ? 0 : -ERANGE;
}}
"""

MAIN = """
#include <stdio.h>

static const struct {{
    const busd_type *type;
    int (*take)(const unsigned char *bytes, size_t size, busd_out *out);
}} types[] = {{
{rows}
}};

static unsigned digit(char c) {{ return (unsigned)(c <= '9' ? c - '0' : c - 'a' + 10); }}

int main(void)
{{
    unsigned number;
    static char line[1 << 22];
    while (scanf("%u %4194303s", &number, line) == 2) {{
        const size_t size = strlen(line) / 2;
        unsigned char *bytes = (unsigned char *)malloc(size + 1);
        for (size_t i = 0; i < size && line[0] != '-'; i++)
            bytes[i] = (unsigned char)(digit(line[2 * i]) << 4 | digit(line[2 * i + 1]));
        busd_out out = {{}};
        const int status = types[number].take(bytes, line[0] == '-' ? 0 : size, &out);
        printf("%s %s %d ", types[number].type->name, types[number].type->hash, status);
        for (size_t i = 0; i < out.size; i++)
            printf("%02x", out.bytes[i]);
        putchar(' ');
        const unsigned char *schema = (const unsigned char *)types[number].type->schema;
        for (size_t i = 0; i < types[number].type->schema_size; i++)
            printf("%02x", schema[i]);
        putchar('\\n');
        free(out.bytes);
        free(bytes);
    }}
}}
"""


@pytest.fixture(scope="session")
def programs(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return c_programs.build_once(tmp_path_factory)


def class_of(name: str) -> type[msgspec.Struct]:
    found = find_type(name)
    assert found is not None
    return found


def repacked(programs: Path, messages: list[bytes]) -> list[str]:
    lines = "".join(f"{message.hex()}\n" for message in messages)
    done = subprocess.run([programs / "repack"], input=lines, capture_output=True, text=True, check=True)
    return done.stdout.splitlines()


def test_golden_frames_are_read_and_written_the_same(programs: Path) -> None:
    frames = [frame for frame in FRAMES if frame["kind"] == "control"]
    bodies = [bytes.fromhex(frame["hex"])[HEAD_BYTES:] for frame in frames]
    assert len(bodies) > 50
    assert repacked(programs, bodies) == [body.hex() for body in bodies]


def test_numbers_and_lengths_have_their_shortest_form(programs: Path) -> None:
    edges = [2**n + more for n in (0, 5, 7, 8, 15, 16, 31, 32, 63) for more in (-1, 0, 1)]
    values: list[Any] = [*edges, *(-edge for edge in edges if edge <= 2**63), None, True, False, 0.1, -1e300]
    for length in (0, 1, 15, 16, 31, 32, 255, 256, 65535, 65536):
        values += ["x" * length, b"x" * length, [0] * length, {str(key): key for key in range(length)}]
    bodies = [msgspec.msgpack.encode(value) for value in values]
    assert repacked(programs, bodies) == [body.hex() for body in bodies]


def test_messages_that_are_cut_or_lie_are_refused(programs: Path) -> None:
    whole = [bytes.fromhex(frame["hex"])[HEAD_BYTES:] for frame in FRAMES if frame["kind"] == "control"]
    cut = [body[:length] for body in whole for length in range(1, len(body))]
    lies = [
        bytes.fromhex(lie)
        for lie in ("dfffffffff", "ddffffffff01", "c6ffffffff00", "dbfffffff0", "c1", "91c1")
    ]
    assert set(repacked(programs, [*cut, *lies])) == {"failed"}


def test_random_bytes_do_no_harm(programs: Path) -> None:
    source = random.Random(38)
    outcomes = repacked(programs, [source.randbytes(source.randrange(1, 60)) for _ in range(20_000)])
    assert len(outcomes) == 20_000


def constants_in(name: str, cls: Any, language: str) -> Iterator[str]:
    """Checks at compile time that constants of a type have the values that its class in Python has."""
    for constant in find_message(name).constants:
        value = getattr(cls, constant.name)
        place = f"{c_name(name)}{'__' if language == 'c' else '::'}{constant.name}"
        if isinstance(value, str):
            same = f'sizeof {place} == sizeof "{value}" && !__builtin_strcmp({place}, "{value}")'
            same = same if language == "c" else f'{place} == "{value}"'
        else:
            same = f"{place} == {value[0] if isinstance(value, bytes) else value}"
        yield f'{"_Static_assert" if language == "c" else "static_assert"}({same}, "{place}");'


def program_of(programs: Path, folder: Path, types: list[str], services: list[str], language: str) -> Path:
    """A program that decodes and encodes these types. It has the headers of the services, too."""
    texts, rows = [], []
    for name in types:
        texts.append(header_of(name, language))
        texts.append(READ.format(name=c_name(name)))
        rows.append(f"    {{&{c_name(name)}__type, take_{c_name(name)}}},")
    texts += [header_of(name, language) for name in services]
    classes: dict[str, Any] = {name: class_of(name) for name in types}
    for name in services:
        for part in ("Request", "Response"):
            classes[f"{name}_{part}"] = getattr(service_class(name), part)
    checks = [check for name, cls in classes.items() for check in constants_in(name, cls, language)]
    assert len(checks) > (400 if is_nightly() else 20)
    texts += checks
    source = folder / f"types.{language}"
    source.write_text("\n".join(texts) + MAIN.format(rows="\n".join(rows)))
    options = ("-O0", "-g0", "-Wno-unused-function", "-Wno-unused-variable")
    compile_it = c_programs.compile_c if language == "c" else c_programs.compile_cpp
    compile_it(programs, source, folder / f"types_{language}", *options)
    return folder / f"types_{language}"


@pytest.fixture(scope="session")
def every_type(programs: Path, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, list[str]]:
    """One program for these types, and the types in its order."""
    types = daily_part(names("msg"))
    folder = tmp_path_factory.mktemp("types")
    return program_of(programs, folder, types, daily_part(names("srv")), "c"), types


def values(description: Any, kind: Any, source: random.Random) -> Any:
    """A random value of a field's type, as plain data."""
    if isinstance(kind, str):
        if "/" in kind:
            return [
                values(description, field["type"], source) for field in description["types"][kind]["fields"]
            ]
        return _plain(kind, source)
    if kind[0] in ("string", "wstring"):
        return "äöü"[: source.randrange(4)]
    least, most = (kind[-2], kind[-1]) if len(kind) >= 3 else (0, 4)
    count = source.randint(least, min(most, least + 3))
    if kind[0] == "bytes":
        return source.randbytes(count)
    return [values(description, kind[1], source) for _ in range(count)]


def _plain(kind: str, source: random.Random) -> Any:
    if kind == "bool":
        return source.random() < 0.5
    if kind in ("float32", "float64"):
        return source.randrange(-(2**20), 2**20) / 1024
    if kind == "string":
        return "".join(source.choice("ab€😀 ") for _ in range(source.randrange(40)))
    if kind == "byte":
        return source.randbytes(1)
    if kind in ("uint8[]", "byte[]"):
        return source.randbytes(source.randrange(300))
    bits = 8 if kind == "char" else int(kind.removeprefix("u").removeprefix("int"))
    low, high = (0, 2**bits) if kind[0] in "uc" else (-(2 ** (bits - 1)), 2 ** (bits - 1))
    return source.choice(
        [low, high - 1, source.randrange(low, high), source.randrange(-20 if low else 0, 100)]
    )


def cases(types: list[str]) -> Iterator[tuple[int, str, bytes]]:
    """Number of the type, the input of the program, and the bytes that it must write."""
    source = random.Random(38)
    for number, name in enumerate(types):
        cls = class_of(name)
        yield number, "-", msgspec.msgpack.encode(cls())
        description = bus.MessageSchema.of(cls).description
        for _ in range(ROUNDS):
            raw = msgspec.msgpack.encode(values(description, name, source))
            encoded = msgspec.msgpack.encode(msgspec.msgpack.decode(raw, type=cls))
            yield number, encoded.hex(), encoded


def agree(program: Path, types: list[str]) -> None:
    """The program reads and writes the bytes of the library, and knows its hashes and schemas."""
    assert len(types) > (400 if is_nightly() else 60)
    wanted = [*cases(types)]
    lines = "".join(f"{number} {given}\n" for number, given, _ in wanted)
    done = subprocess.run([program], input=lines, capture_output=True, text=True, check=True)
    schemas = [bus.MessageSchema.of(class_of(name)) for name in types]
    assert done.stdout.splitlines() == [
        f"{types[number]} {schemas[number].type_hash} 0 {encoded.hex()} {schemas[number].encoded.hex()}"
        for number, _, encoded in wanted
    ]


def test_every_type_agrees_with_the_library(every_type: tuple[Path, list[str]]) -> None:
    agree(*every_type)


@pytest.mark.skipif(bool(c_programs.why_no_cpp()), reason=c_programs.why_no_cpp())
def test_types_in_cpp_agree_with_the_library(programs: Path, tmp_path: Path) -> None:
    types = daily_part(names("msg"))
    agree(program_of(programs, tmp_path, types, [], "cpp"), types)


def test_bytes_of_another_type_are_refused(every_type: tuple[Path, list[str]]) -> None:
    program, types = every_type
    number = types.index("sensor_msgs/msg/Imu")
    whole = msgspec.msgpack.encode(class_of(types[number])())
    wrong = [whole[:length] for length in range(1, len(whole))]
    wrong += [bytes.fromhex(one) for one in ("90", "c0", "a0", "91a26869", "dcffff")]
    lines = "".join(f"{number} {one.hex()}\n" for one in wrong)
    done = subprocess.run([program], input=lines, capture_output=True, text=True, check=True)
    assert {line.split()[2] for line in done.stdout.splitlines()} == {"-74"}
