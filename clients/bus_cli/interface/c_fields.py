"""Fields of messages in C and C++: how each is declared, set to its default, encoded and decoded; constants.

The two languages differ in the types of texts, bytes, lists and structs (`C`, `CPP`). All the rest is the
same text.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any, NamedTuple, TypeAlias

__all__ = [
    "CPP",
    "C",
    "FieldType",
    "Form",
    "Language",
    "UnsupportedType",
    "c_name",
    "constant",
    "form",
    "initial",
    "member",
]

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


class UnsupportedType(ValueError):
    """A field has no form in C. The text names the field and its type."""


class Language(NamedTuple):
    """Types in one of the two languages."""

    name: str
    text: str
    bytes: str

    def struct(self, type_name: str) -> str:
        if self is C:
            return c_name(type_name)
        return "::" + "::".join(member(part) for part in type_name.split("/"))

    def view(self, item: FieldType, item_type: str) -> str:
        if self is CPP:
            return f"busd::span<const {item_type}>"
        name = item if isinstance(item, str) else item[0]
        return f"{c_name(name)}__list" if "/" in name else f"busd_{_LISTS.get(name, name)}_list"

    def declaration(self, form: "Form", name: str, default: Any) -> str:
        """The member of a struct. In C++ with its default."""
        if self is C:
            return f"{form.type} {name}{'' if form.length is None else f'[{form.length}]'};"
        declared = form.type if form.length is None else f"std::array<{form.type}, {form.length}>"
        return f"{declared} {name}{'{}' if default is None else f' = {_value(default)}'};"


C = Language("c", "busd_text", "busd_bytes")
CPP = Language("cpp", "std::string_view", "busd::span<const uint8_t>")


class Form(NamedTuple):
    """How a field is declared, encoded and decoded. `{x}` is the field, `{i}` the loop's variable."""

    type: str
    init: str
    put: str
    get: str
    length: int | None = None
    """Of an array; `type` is then the type of its items."""


def c_name(type_name: str) -> str:
    """The name of the struct: `std_msgs/msg/String` is `std_msgs__msg__String`."""
    return type_name.replace("/", "__")


def member(name: str) -> str:
    """The name of a member. Words that C or C++ reserves get an underscore."""
    return f"{name}_" if name in _RESERVED else name


def initial(place: str, form: Form, default: Any) -> str:
    """The statement in C that sets a field to its default; "" if that is zero."""
    if default is None:
        return form.init.format(x=place, i="i")
    value = _value(default)
    return f"{place} = busd_text_of({value});" if isinstance(default, str) else f"{place} = {value};"


def constant(owner: str, name: str, kind: str, value: Any, language: Language) -> str:
    """The definition of a constant of the type `owner`: in C a macro, in C++ a member of the struct.

    A member with the name of its struct gets an underscore at its end.
    """
    if isinstance(value, bytes):  # of the type byte
        value = value[0]
    text = _value(value)
    if kind == "float32":
        text = f"(float){text}"
    elif kind.startswith("u") and isinstance(value, int) and 2**31 <= value < 2**32:
        text += "u"
    if language is C:
        is_one_word = text.isalnum() or isinstance(value, str)
        return f"#define {c_name(owner)}__{name} {text if is_one_word else f'({text})'}"
    if isinstance(value, str):
        declared = language.text
    else:
        declared = _FLOATS.get(kind) or _INTEGERS.get(kind, ({"byte": "uint8_t"}.get(kind, kind), ""))[0]
    if name == owner.rpartition("/")[2]:
        name += "_"  # a member may not have the name of its struct
    return f"static constexpr {declared} {name} = {text};"


def _value(default: Any) -> str:
    if isinstance(default, bool):
        return str(default).lower()
    if isinstance(default, str):
        return _text(default)
    if isinstance(default, int | float):
        return _number(default)
    raise UnsupportedType(f"the default {default!r} has no form in C")


def _text(text: str) -> str:
    """A literal, in UTF-8. Escapes other than the octal ones could take in the next character."""
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


def form(owner: str, field: Mapping[str, Any], language: Language) -> Form:
    """The form of a field of the type `owner`. Raises UnsupportedType."""
    kind = field["type"]
    found = _of_list(kind, language) if not isinstance(kind, str) else None
    if found is None:
        found = _of_single(kind, language)
    if found is None:
        raise UnsupportedType(
            f"field {field['name']!r} of {owner} has the type {kind}, which has no form in C"
        )
    return found


def _of_single(kind: FieldType, language: Language) -> Form | None:
    if isinstance(kind, str):
        if kind in _INTEGERS:
            return _of_integer(*_INTEGERS[kind])
        if kind in _FLOATS:
            cast = "(float)" if kind == "float32" else ""
            return Form(_FLOATS[kind], "", "busd_put_float(out, {x});", f"{{x}} = {cast}busd_get_float(in);")
        if kind == "bool":
            return Form("bool", "", "busd_put_bool(out, {x});", "{x} = busd_get_bool(in);")
        if kind == "byte":
            return Form("uint8_t", "", "busd_put_bytes(out, &{x}, 1);", "busd_get_bytes_copy(in, &{x}, 1);")
        if kind in _BYTES:
            return _of_bytes(_NO_LIMIT, language)
        if "/" in kind:
            name = c_name(kind)
            put, get = f"{name}__put(out, &{{x}});", f"{name}__get(in, &{{x}}, arena);"
            return Form(language.struct(kind), f"{name}__init(&{{x}});", put, get)
        return _of_text(_NO_LIMIT, language) if kind == "string" else None
    if kind[0] in ("string", "wstring"):
        # The limit of a text counts characters, which have up to four bytes.
        return _of_text(str(4 * kind[1]) if len(kind) > 1 else _NO_LIMIT, language)
    return None


def _of_integer(declared: str, least: str, most: str) -> Form:
    if declared.startswith("u"):
        get = f"{{x}} = ({declared})busd_get_uint(in, {most});"
        return Form(declared, "", "busd_put_uint(out, {x});", get)
    get = f"{{x}} = ({declared})busd_get_int(in, {least}, {most});"
    return Form(declared, "", "busd_put_int(out, {x});", get)


def _of_text(most: str, language: Language) -> Form:
    put, get = f"busd_put_text_view(out, {{x}}, {most});", "busd_get_text_view(in, &{x});"
    return Form(language.text, "", put, get)


def _of_bytes(most: str, language: Language) -> Form:
    put, get = f"busd_put_bytes_view(out, {{x}}, {most});", f"busd_get_bytes_view(in, &{{x}}, {most});"
    return Form(language.bytes, "", put, get)


def _of_list(kind: Sequence[Any], language: Language) -> Form | None:
    if kind[0] == "bytes":
        least, most = kind[1:3]
        if least != most:
            return _of_bytes(str(most), language)
        put, get = f"busd_put_bytes(out, &{{x}}[0], {most});", f"busd_get_bytes_copy(in, &{{x}}[0], {most});"
        return Form("uint8_t", "", put, get, most)
    if kind[0] != "list":
        return None
    item = kind[1]
    one = _of_single(item, language)
    if one is None:
        return None
    if len(kind) == 4 and kind[2] == kind[3]:
        return _of_array(one, kind[2])
    return _of_view(one, language.view(item, one.type), str(kind[3]) if len(kind) == 4 else _NO_LIMIT)


def _of_array(one: Form, length: int) -> Form:
    loop = f"for (size_t {{i}} = 0; {{i}} < {length}; {{i}}++)\n        "
    item = {"x": "{x}[{i}]", "i": "{i}"}
    return Form(
        one.type,
        loop + one.init.format(**item) if one.init else "",
        f"busd_put_array(out, {length});\n    {loop}{one.put.format(**item)}",
        f"if (!busd_get_array(in, {length}))\n        return;\n    {loop}{one.get.format(**item)}",
        length,
    )


def _of_view(one: Form, view: str, most: str) -> Form:
    put = one.put.format(x="{x}.items[{i}]", i="{i}")
    get = one.get.format(x="items[{i}]", i="{i}")
    return Form(
        view,
        "",
        f"busd_put_count(out, {{x}}.count, {most});\n"
        f"    for (size_t {{i}} = 0; {{i}} < {{x}}.count; {{i}}++)\n        {put}",
        "{{\n"
        f"        const size_t count = busd_get_count(in, {most});\n"
        f"        {one.type} *items = ({one.type} *)busd_arena_take(arena, count, sizeof *items);\n"
        "        if (count != 0 && items == NULL) {{\n"
        "            in->failed = true;\n"
        "            return;\n"
        "        }}\n"
        f"        for (size_t {{i}} = 0; {{i}} < count && !in->failed; {{i}}++)\n            {get}\n"
        "        {x}.items = items;\n"
        "        {x}.count = count;\n"
        "    }}",
    )
