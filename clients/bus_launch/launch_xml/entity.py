"""An element of a launch file in XML."""

from typing import Any
from xml.etree.ElementTree import Element

from bus_launch.launch.frontend import Entity as BaseEntity
from bus_launch.launch.frontend.entity import coerce, is_list_of_entities, name_of, refuse_unknown

__all__ = ["Entity"]


class Entity(BaseEntity):
    """Attributes are texts, converted to the requested types. `name-sep` cuts an attribute into a list."""

    def __init__(self, xml_element: Element, *, parent: "Entity | None" = None) -> None:
        self._element = xml_element
        self._parent = parent
        self._read: set[str] = set()
        self._asked: set[str] = set()
        self._below: list[Entity] | None = None
        text = (xml_element.text or "").strip()
        if text:
            raise ValueError(f"Unexpected text found in `{xml_element.tag}`: '{text}'")

    @property
    def type_name(self) -> str:
        return self._element.tag

    @property
    def parent(self) -> "Entity | None":
        return self._parent

    @property
    def children(self) -> list[BaseEntity]:
        found = self._children()
        self._read.update(one.type_name for one in found)
        return list(found)

    def _children(self) -> "list[Entity]":
        if self._below is None:
            self._below = [Entity(one, parent=self) for one in self._element if isinstance(one.tag, str)]
        return self._below

    def assert_entity_completely_parsed(self) -> None:
        tags = {one.type_name for one in self._children()}
        refuse_unknown("nested tag(s)", tags - self._read, self.type_name, self._asked)
        refuse_unknown("attribute(s)", set(self._element.attrib) - self._read, self.type_name, self._asked)

    def get_attr(
        self, name: str, *, data_type: Any = str, optional: bool = False, can_be_str: bool = True
    ) -> Any:
        self._asked.add(name)
        if is_list_of_entities(data_type):
            found = [one for one in self._children() if one.type_name == name]
            if found:
                self._read.add(name)
                return found
        elif name in self._element.attrib:
            self._read.add(name)
            return self._typed(name, data_type, can_be_str)
        if optional:
            return None
        raise AttributeError(
            f"Attribute '{name}' of type '{name_of(data_type)}' not found in Entity '{self.type_name}'"
        )

    def _typed(self, name: str, data_type: Any, can_be_str: bool) -> Any:
        value: Any = self._element.attrib[name]
        separator = self._element.attrib.get(f"{name}-sep")
        if separator is not None:
            self._read.add(f"{name}-sep")
            value = value.split(separator)
            if data_type is None:
                value = [coerce(one, None, can_be_str) for one in value]
        try:
            return coerce(value, data_type, can_be_str)
        except ValueError:
            raise TypeError(
                f"Attribute '{name}' of Entity '{self.type_name}' expected to be of type "
                f"'{name_of(data_type)}'. '{value}' can not be converted to one of those types"
            ) from None
