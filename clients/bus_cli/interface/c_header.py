"""A C header for a message type: its struct, its functions, and the description that busd needs.

Pure: it gets the description of a type, and returns text. The header needs `busd/types.h` of `clients/c`.
Encoded messages are the same as those of the library, byte for byte.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

__all__ = ["Described", "UnsupportedType", "c_name", "header", "service_header"]

FieldType: TypeAlias = str | Sequence[Any]

_INTEGERS = {
    "char": ("uint8_t", "0", "UINT8_MAX"),
    "int": ("int64_t", "INT64_MIN", "INT64_MAX"),
    **{f"int{n}": (f"int{n}_t", f"INT{n}_MIN", f"INT{n}_MAX") for n in (8, 16, 32, 64)},
    **{f"uint{n}": (f"uint{n}_t", "0", f"UINT{n}_MAX") for n in (8, 16, 32, 64)},
}
_FLOATS = {"float32": "float", "float64": "double"}
_LISTS = {"char": "uint8", "int": "int64", "string": "text", "wstring": "text"}
_BYTES = ("uint8[]", "byte[]")
_NO_LIMIT = "SIZE_MAX"
_RESERVED = frozenset(
    """
    alignas alignof and and_eq asm auto bitand bitor bool break case catch char char8_t char16_t char32_t
    class co_await co_return co_yield compl concept const const_cast consteval constexpr constinit continue
    decltype default delete do double dynamic_cast else enum errno explicit export extern false float for
    friend goto if inline int linux long mutable namespace new noexcept not not_eq nullptr operator or or_eq
    private protected public register reinterpret_cast requires restrict return short signed sizeof static
    static_assert static_cast stderr stdin stdout struct switch template this thread_local throw true try
    typedef typeid typename typeof union unix unsigned using virtual void volatile wchar_t while xor xor_eq
    """.split()  # noqa: SIM905 - a list of this length is easier to read as a text
)
_LINE_BYTES = 20


class UnsupportedType(ValueError):
    """A field has no form in C. The text names the field and its type."""


class _Form(NamedTuple):
    """How a field is declared, encoded and decoded. `{x}` is the field, `{i}` the loop's variable."""

    declaration: str
    init: str
    put: str
    get: str


class Described(NamedTuple):
    """A type as busd knows it: name, hash, and the schema as MessagePack."""

    name: str
    hash: str
    schema: bytes


def c_name(type_name: str) -> str:
    """The name of the struct: `std_msgs/msg/String` is `std_msgs__msg__String`."""
    return type_name.replace("/", "__")


def header(description: Mapping[str, Any], described: Described) -> str:
    """The text of the header of a type, with all types that it needs. Raises UnsupportedType."""
    lines = _structs(description)
    lines += [*_schema(described), f"static const busd_type {c_name(described.name)}__type ="]
    lines += [f"    {_type(described)};", "", f"BUSD_MESSAGE({c_name(described.name)})", ""]
    return _guarded(described.name, lines)


def service_header(
    name: str, bodies: Sequence[Mapping[str, Any]], envelopes: tuple[Described, Described]
) -> str:
    """The same of a service. `bodies`: descriptions of the request and of the response."""
    lines = [line for body in bodies for line in _structs(body)]
    for envelope in envelopes:
        lines += _schema(envelope)
    lines += [f"typedef struct {c_name(name)} {c_name(name)}; /* only a name, for C++ */", ""]
    lines += [f"static const busd_service_type {c_name(name)}__service = {{"]
    lines += [
        *(f"    {_type(envelope)}," for envelope in envelopes),
        "};",
        "",
        f"BUSD_SERVICE({c_name(name)})",
        "",
    ]
    return _guarded(name, lines)


def _guarded(name: str, lines: Sequence[str]) -> str:
    guard = f"BUSD_HEADER_{c_name(name)}"
    first = f"/* {name}, made by `bus interface c`. */"
    return "\n".join(
        [
            first,
            f"#ifndef {guard}",
            f"#define {guard}",
            "",
            "#include <busd/types.h>",
            "",
            *lines,
            "#endif",
            "",
        ]
    )


def _structs(description: Mapping[str, Any]) -> list[str]:
    types = description["types"]
    return [
        line for name in _in_order(types, description["root"]) for line in (*_struct(name, types[name]), "")
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


def _struct(name: str, description: Mapping[str, Any]) -> Iterator[str]:
    struct, fields = c_name(name), description["fields"]
    if not description.get("array"):
        raise UnsupportedType(f"{name} is a map, and not an array of its fields; it has no form in C")
    forms = [(_member(field["name"]), _form(name, field), field) for field in fields]
    yield f"#ifndef BUSD_TYPE_{struct}"
    yield f"#define BUSD_TYPE_{struct}"
    yield f"typedef struct {struct} {{"
    for member, form, _ in forms:
        yield f"    {form.declaration.format(x=member)};"
    if not forms:
        yield "    unsigned char has_no_fields;"
    yield f"}} {struct};"
    yield f"BUSD_LIST({struct}__list, {struct});"
    yield f"static inline void {struct}__init({struct} *m)"
    yield "{"
    yield "    memset(m, 0, sizeof *m);"
    for member, form, field in forms:
        if text := _initial(f"m->{member}", form, field.get("default")):
            yield f"    {text}"
    yield "}"
    yield f"static inline void {struct}__put(busd_out *out, const {struct} *m)"
    yield "{"
    yield f"    busd_put_array(out, {len(forms)});"
    for member, form, _ in forms:
        yield f"    {form.put.format(x=f'm->{member}', i='i')}"
    if not forms:
        yield "    (void)m;"
    yield "}"
    yield f"static inline void {struct}__get(busd_in *in, {struct} *m, busd_arena *arena)"
    yield "{"
    yield "    (void)arena;"
    yield "    memset(m, 0, sizeof *m);"
    yield f"    if (!busd_get_array(in, {len(forms)}))"
    yield "        return;"
    for member, form, _ in forms:
        yield f"    {form.get.format(x=f'm->{member}', i='i')}"
    yield "}"
    yield "#endif"


def _schema(described: Described) -> Iterator[str]:
    yield f"static const unsigned char {c_name(described.name)}__schema[] = {{"
    for start in range(0, len(described.schema), _LINE_BYTES):
        yield "    " + " ".join(f"0x{byte:02x}," for byte in described.schema[start : start + _LINE_BYTES])
    yield "};"


def _type(described: Described) -> str:
    schema = f"{c_name(described.name)}__schema"
    return f'{{"{described.name}", "{described.hash}", {schema}, sizeof {schema}}}'


def _member(name: str) -> str:
    return f"{name}_" if name in _RESERVED else name


def _initial(place: str, form: _Form, default: Any) -> str:
    """The statement that sets a field to its default; "" if that is zero."""
    if default is None:
        return form.init.format(x=place, i="i")
    if isinstance(default, bool):
        return f"{place} = {str(default).lower()};"
    if isinstance(default, str):
        return f"{place} = busd_text_of({_text(default)});"
    if isinstance(default, int | float):
        return f"{place} = {_number(default)};"
    raise UnsupportedType(f"the default {default!r} has no form in C")


def _text(text: str) -> str:
    """A literal in C, in UTF-8. Escapes other than the octal ones could take in the next character."""
    plain = (
        chr(byte) if 32 <= byte < 127 and byte not in b'"\\?' else f"\\{byte:03o}" for byte in text.encode()
    )
    return f'"{"".join(plain)}"'


def _number(number: float) -> str:
    if isinstance(number, int):
        return (
            "INT64_MIN" if number == -(2**63) else f"UINT64_C({number})" if number >= 2**63 else str(number)
        )
    if math.isnan(number):
        return '__builtin_nan("")'
    return repr(number) if math.isfinite(number) else f"{'-' if number < 0 else ''}__builtin_inf()"


def _form(owner: str, field: Mapping[str, Any]) -> _Form:
    kind = field["type"]
    form = _of_list(kind) if not isinstance(kind, str) else None
    if form is None:
        form = _of_single(kind)
    if form is None:
        raise UnsupportedType(
            f"field {field['name']!r} of {owner} has the type {kind}, which has no form in C"
        )
    return form


def _of_single(kind: FieldType) -> _Form | None:
    if isinstance(kind, str):
        if kind in _INTEGERS:
            return _of_integer(*_INTEGERS[kind])
        if kind in _FLOATS:
            cast = "(float)" if kind == "float32" else ""
            return _Form(
                f"{_FLOATS[kind]} {{x}}",
                "",
                "busd_put_float(out, {x});",
                f"{{x}} = {cast}busd_get_float(in);",
            )
        if kind == "bool":
            return _Form("bool {x}", "", "busd_put_bool(out, {x});", "{x} = busd_get_bool(in);")
        if kind == "byte":
            return _Form(
                "uint8_t {x}", "", "busd_put_bytes(out, &{x}, 1);", "busd_get_bytes_copy(in, &{x}, 1);"
            )
        if kind in _BYTES:
            return _of_bytes(_NO_LIMIT)
        if "/" in kind:
            struct = c_name(kind)
            return _Form(
                f"{struct} {{x}}",
                f"{struct}__init(&{{x}});",
                f"{struct}__put(out, &{{x}});",
                f"{struct}__get(in, &{{x}}, arena);",
            )
        return _of_text(_NO_LIMIT) if kind == "string" else None
    if kind[0] in ("string", "wstring"):
        # The limit of a text counts characters, which have up to four bytes.
        return _of_text(str(4 * kind[1]) if len(kind) > 1 else _NO_LIMIT)
    return None


def _of_integer(declared: str, least: str, most: str) -> _Form:
    if declared.startswith("u"):
        get = f"{{x}} = ({declared})busd_get_uint(in, {most});"
        return _Form(f"{declared} {{x}}", "", "busd_put_uint(out, {x});", get)
    get = f"{{x}} = ({declared})busd_get_int(in, {least}, {most});"
    return _Form(f"{declared} {{x}}", "", "busd_put_int(out, {x});", get)


def _of_text(most: str) -> _Form:
    put = f"busd_put_text_view(out, {{x}}, {most});"
    return _Form("busd_text {x}", "", put, "{x} = busd_get_text_view(in);")


def _of_bytes(most: str) -> _Form:
    put, get = f"busd_put_bytes_view(out, {{x}}, {most});", f"{{x}} = busd_get_bytes_view(in, {most});"
    return _Form("busd_bytes {x}", "", put, get)


def _of_list(kind: Sequence[Any]) -> _Form | None:
    if kind[0] == "bytes":
        least, most = kind[1:3]
        if least != most:
            return _of_bytes(str(most))
        put, get = f"busd_put_bytes(out, {{x}}, {most});", f"busd_get_bytes_copy(in, {{x}}, {most});"
        return _Form(f"uint8_t {{x}}[{most}]", "", put, get)
    if kind[0] != "list":
        return None
    item = kind[1]
    one = _of_single(item)
    if one is None:
        return None
    if len(kind) == 4 and kind[2] == kind[3]:
        return _of_array(one, kind[2])
    return _of_view(item, one, str(kind[3]) if len(kind) == 4 else _NO_LIMIT)


def _of_array(one: _Form, length: int) -> _Form:
    loop = f"for (size_t {{i}} = 0; {{i}} < {length}; {{i}}++)\n        "
    item = {"x": "{x}[{i}]", "i": "{i}"}
    return _Form(
        one.declaration.format(x=f"{{x}}[{length}]"),
        loop + one.init.format(**item) if one.init else "",
        f"busd_put_array(out, {length});\n    {loop}{one.put.format(**item)}",
        f"if (!busd_get_array(in, {length}))\n        return;\n    {loop}{one.get.format(**item)}",
    )


def _of_view(item: FieldType, one: _Form, most: str) -> _Form:
    name = item if isinstance(item, str) else item[0]
    view = f"{c_name(name)}__list" if "/" in name else f"busd_{_LISTS.get(name, name)}_list"
    element = one.declaration.format(x="").strip()
    put = one.put.format(x="{x}.items[{i}]", i="{i}")
    get = one.get.format(x="items[{i}]", i="{i}")
    return _Form(
        f"{view} {{x}}",
        "",
        f"busd_put_count(out, {{x}}.count, {most});\n"
        f"    for (size_t {{i}} = 0; {{i}} < {{x}}.count; {{i}}++)\n        {put}",
        "{{\n"
        f"        const size_t count = busd_get_count(in, {most});\n"
        f"        {element} *items = ({element} *)busd_arena_take(arena, count, sizeof *items);\n"
        "        if (count != 0 && items == NULL) {{\n"
        "            in->failed = true;\n"
        "            return;\n"
        "        }}\n"
        f"        for (size_t {{i}} = 0; {{i}} < count && !in->failed; {{i}}++)\n            {get}\n"
        "        {x}.items = items;\n"
        "        {x}.count = count;\n"
        "    }}",
    )
