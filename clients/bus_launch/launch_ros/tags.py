"""Tags below a tag of a node, and their attributes: conditions, parameters, remappings."""

from typing import Any, List  # noqa: UP035 (the genuine one's `data_type`)

from bus_launch.launch.conditions import IfCondition, UnlessCondition
from bus_launch.launch.core import Condition
from bus_launch.launch.frontend import Entity, Parser
from bus_launch.launch_ros.parameter_descriptions import ParameterFile
from bus_launch.launch_ros.parameter_values import ParameterValue

__all__ = ["parse_condition", "parse_extra_arguments", "parse_parameters", "parse_remaps"]


def parse_condition(entity: Entity, parser: Parser) -> Condition | None:
    """The condition of `if=` or `unless=`. None without one."""
    if_text = entity.get_attr("if", optional=True)
    unless_text = entity.get_attr("unless", optional=True)
    if if_text is not None and unless_text is not None:
        raise RuntimeError("if and unless conditions can't be used simultaneously")
    if if_text is not None:
        return IfCondition(parser.parse_substitution(if_text))
    return None if unless_text is None else UnlessCondition(parser.parse_substitution(unless_text))


def parse_remaps(entity: Entity, parser: Parser) -> list[tuple[Any, Any]] | None:
    """`<remap from= to=>`. None if there are none."""
    return _pairs(entity, parser, "remap", "from", "to")


def parse_extra_arguments(entity: Entity, parser: Parser) -> list[dict[Any, Any]] | None:
    """`<extra_arg name= value=>`. None if there are none."""
    pairs = _pairs(entity, parser, "extra_arg", "name", "value")
    return None if pairs is None else [{tuple(name): value} for name, value in pairs]


def _pairs(entity: Entity, parser: Parser, tag: str, first: str, second: str) -> list[tuple[Any, Any]] | None:
    entities = entity.get_attr(tag, data_type=List[Entity], optional=True)  # noqa: UP006
    if entities is None:
        return None
    found = [
        (parser.parse_substitution(one.get_attr(first)), parser.parse_substitution(one.get_attr(second)))
        for one in entities
    ]
    for one in entities:
        one.assert_entity_completely_parsed()
    return found


def parse_parameters(entity: Entity, parser: Parser) -> list[Any] | None:
    """`<param name= value=>`, nested ones, and `<param from=>`. None if there are none."""
    entities = entity.get_attr("param", data_type=List[Entity], optional=True)  # noqa: UP006
    if entities is None:
        return None
    found: list[Any] = []
    values: dict[Any, Any] = {}
    for one in entities:
        file = one.get_attr("from", optional=True)
        name = one.get_attr("name", optional=True)
        if file is not None and name is not None:
            raise RuntimeError("name and from attributes are mutually exclusive")
        if file is not None:
            allow = one.get_attr("allow_substs", data_type=bool, optional=True)
            found.append(ParameterFile(parser.parse_substitution(file), allow_substs=bool(allow)))
            one.assert_entity_completely_parsed()
        elif name is not None:
            values |= _parse_nested(one, parser)
        else:
            raise ValueError("param Entity should have name or from attribute")
    return [*found, values] if values else found


def _parse_nested(entity: Entity, parser: Parser) -> dict[Any, Any]:
    name = tuple(parser.parse_substitution(entity.get_attr("name")))
    value = entity.get_attr("value", data_type=None, optional=True)
    kind = entity.get_attr("type", optional=True)
    below = entity.get_attr("param", data_type=List[Entity], optional=True)  # noqa: UP006
    entity.assert_entity_completely_parsed()
    if (value is None) == (not below):
        raise RuntimeError("param entity: either a value attribute or nested params are needed")
    if below:
        nested: dict[Any, Any] = {}
        for one in below:
            nested |= _parse_nested(one, parser)
        return {name: nested}
    if kind is not None:
        kinds: dict[str, Any] = {
            "bool": bool,
            "int": int,
            "float": float,
            "str": str,
            "list_of_bool": list[bool],
            "list_of_int": list[int],
            "list_of_float": list[float],
            "list_of_str": list[str],
        }
        if kind not in kinds:
            raise ValueError(
                f"param '{entity.get_attr('name')}': type '{kind}' is none of {', '.join(kinds)}"
            )
        value = value if isinstance(value, list) else str(value)
        return {name: ParameterValue(parser.parse_if_substitutions(value), value_type=kinds[kind])}
    return {name: parser.parse_if_substitutions(value)}
