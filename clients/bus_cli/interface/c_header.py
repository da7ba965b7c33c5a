"""A header for C or C++ for a message type: its struct, its functions, and the description that busd needs.

Pure: it gets the description of a type, and returns text. The header needs `busd/types.h` of `clients/c`,
in C++ `busd/types.hpp` of `clients/cpp`. Encoded messages are the same as the library's, byte for byte.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

from bus_cli.interface.c_fields import (
    CPP,
    C,
    FieldType,
    Language,
    UnsupportedType,
    c_name,
    constant,
    form,
    initial,
    member,
)

__all__ = ["LANGUAGES", "Constants", "Described", "header", "service_header"]

LANGUAGES = {language.name: language for language in (C, CPP)}
Constants: TypeAlias = Mapping[str, Sequence[tuple[str, str, Any]]]
"""Constants of types: name, type and value of each."""
_LINE_BYTES = 20


class Described(NamedTuple):
    """A type as busd knows it: name, hash, and the schema as MessagePack."""

    name: str
    hash: str
    schema: bytes


def header(
    description: Mapping[str, Any], described: Described, constants: Constants, language: Language
) -> str:
    """The text of the header of a type, with all types that it needs. Raises UnsupportedType."""
    lines = _structs(description, constants, language)
    lines += [*_schema(described), f"static const busd_type {c_name(described.name)}__type ="]
    lines += [f"    {_type(described)};", "", *_macros("MESSAGE", described.name, language), ""]
    return _guarded(described.name, lines, language)


def service_header(
    name: str,
    bodies: Sequence[Mapping[str, Any]],
    envelopes: tuple[Described, Described],
    constants: Constants,
    language: Language,
) -> str:
    """The same of a service. `bodies`: descriptions of the request and of the response."""
    lines = [line for body in bodies for line in _structs(body, constants, language)]
    for envelope in envelopes:
        lines += _schema(envelope)
    if language is CPP:
        parts = ("Request", "Response")
        lines += _in_namespace(
            name, [f"    using {part} = {CPP.struct(f'{name}_{part}')};" for part in parts]
        )
        lines.append("")
    lines += [f"static const busd_service_type {c_name(name)}__service = {{"]
    lines += [
        *(f"    {_type(envelope)}," for envelope in envelopes),
        "};",
        "",
        *_macros("SERVICE", name, language),
        "",
    ]
    return _guarded(name, lines, language)


def _macros(kind: str, name: str, language: Language) -> Iterator[str]:
    """The functions that need no fields; in C++ also the description for `busd.hpp`."""
    yield f"BUSD_{kind}({c_name(name)})"
    if language is CPP:
        yield f"BUSD_{kind}_CPP({c_name(name)})"


def _guarded(name: str, lines: Sequence[str], language: Language) -> str:
    guard = f"BUSD_HEADER_{c_name(name)}"
    include = "#include <busd/types.h>" if language is C else "#include <busd/types.hpp>"
    first = f"/* {name}, made by `bus interface {language.name}`. */"
    return "\n".join(
        [
            first,
            *_once(guard, name, language, ["", include, "", *lines]),
            "",
        ]
    )


def _once(macro: str, name: str, language: Language, lines: Iterable[str]) -> Iterator[str]:
    """Lines that a source gets once; an error if it already has the other language's lines.

    Both languages have the same names of functions.
    """
    number, other = (1, "cpp") if language is C else (2, "c")
    yield f"#if defined {macro} && {macro} != {number}"
    yield f"#error \"{name} is already here for 'bus interface {other}'; a source has it for C or for C++\""
    yield "#endif"
    yield f"#ifndef {macro}"
    yield f"#define {macro} {number}"
    yield from lines
    yield "#endif"


def _structs(description: Mapping[str, Any], constants: Constants, language: Language) -> list[str]:
    types = description["types"]
    return [
        line
        for name in _in_order(types, description["root"])
        for line in (
            *_once(
                f"BUSD_TYPE_{c_name(name)}",
                name,
                language,
                _struct(name, types[name], constants.get(name, ()), language),
            ),
            "",
        )
    ]


def _in_order(types: Mapping[str, Any], name: str, found: dict[str, None] | None = None) -> Iterator[str]:
    """The types that `name` needs, each once and before its users; then `name`."""
    found = {} if found is None else found
    for field in types[name]["fields"]:
        for part in _parts(field["type"]):
            if part in types and part not in found:
                yield from _in_order(types, part, found)
    if name not in found:
        found[name] = None
        yield name


def _parts(kind: FieldType) -> Iterator[str]:
    if isinstance(kind, str):
        yield kind
    else:
        for part in kind[1:]:
            if isinstance(part, str | list | tuple):
                yield from _parts(part)


def _struct(
    name: str,
    description: Mapping[str, Any],
    constants: Sequence[tuple[str, str, Any]],
    language: Language,
) -> Iterator[str]:
    struct, fields = c_name(name), description["fields"]
    if not description.get("array"):
        raise UnsupportedType(f"{name} is a map, and not an array of its fields; it has no form in C")
    forms = [(member(field["name"]), form(name, field, language), field.get("default")) for field in fields]
    members = [f"    {language.declaration(how, field, default)}" for field, how, default in forms]
    values = [constant(name, *one, language) for one in constants]
    if language is C:
        yield from values
        yield f"typedef struct {struct} {{"
        yield from members or ["    unsigned char has_no_fields;"]
        yield f"}} {struct};"
        yield f"BUSD_LIST({struct}__list, {struct});"
    else:
        yield from _in_namespace(name, [*(f"    {value}" for value in values), *members])
    zero = "memset(m, 0, sizeof *m);" if language is C else "*m = {};"
    yield f"static inline void {struct}__init({struct} *m)"
    yield "{"
    yield f"    {zero}"
    for field, how, default in forms if language is C else ():
        if text := initial(f"m->{field}", how, default):
            yield f"    {text}"
    yield "}"
    yield f"static inline void {struct}__put(busd_out *out, const {struct} *m)"
    yield "{"
    yield f"    busd_put_array(out, {len(forms)});"
    for field, how, _ in forms:
        yield f"    {how.put.format(x=f'm->{field}', i='i')}"
    if not forms:
        yield "    (void)m;"
    yield "}"
    yield f"static inline void {struct}__get(busd_in *in, {struct} *m, busd_arena *arena)"
    yield "{"
    yield "    (void)arena;"
    yield f"    {zero}"
    yield f"    if (!busd_get_array(in, {len(forms)}))"
    yield "        return;"
    for field, how, _ in forms:
        yield f"    {how.get.format(x=f'm->{field}', i='i')}"
    yield "}"


def _in_namespace(name: str, members: Sequence[str]) -> Iterator[str]:
    """A struct in C++. Its name in C is an alias, because the functions and macros are the same text."""
    *spaces, last = (member(part) for part in name.split("/"))
    yield f"namespace {'::'.join(spaces)} {{"
    yield f"struct {last} {{"
    yield from members
    yield "};"
    yield "}"
    yield f"using {c_name(name)} = {CPP.struct(name)};"


def _schema(described: Described) -> Iterator[str]:
    yield f"static const unsigned char {c_name(described.name)}__schema[] = {{"
    for start in range(0, len(described.schema), _LINE_BYTES):
        yield "    " + " ".join(f"0x{byte:02x}," for byte in described.schema[start : start + _LINE_BYTES])
    yield "};"


def _type(described: Described) -> str:
    schema = f"{c_name(described.name)}__schema"
    return f'{{"{described.name}", "{described.hash}", {schema}, sizeof {schema}}}'
