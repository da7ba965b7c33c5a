"""An element of a launch file in YAML."""

from typing import Any

from bus_launch.launch.errors import short
from bus_launch.launch.frontend import Entity as BaseEntity
from bus_launch.launch.frontend.entity import coerce, is_list_of_entities, name_of, refuse_unknown

__all__ = ["Entity"]

_CHILDREN = "children"


class Entity(BaseEntity):
    """`- node: {pkg: ..., exec: ...}`: a name, and a mapping of attributes, or a list of what is in it."""

    def __init__(self, element: Any, type_name: str | None = None, *, parent: "Entity | None" = None) -> None:
        if type_name is None:
            if not isinstance(element, dict) or len(element) != 1:
                raise RuntimeError(f"Expected a len 1 dictionary, got {short(element)}")
            ((type_name, element),) = element.items()
        self._name = str(type_name)
        self._element = {} if element is None else element
        self._parent = parent
        self._read: set[str] = set()
        self._asked: set[str] = set()
        self._has_read_children = False

    @property
    def type_name(self) -> str:
        return self._name

    @property
    def parent(self) -> "Entity | None":
        return self._parent

    @property
    def children(self) -> list[BaseEntity]:
        self._has_read_children = True
        found = self._element
        if isinstance(found, dict):
            if _CHILDREN not in found:
                raise ValueError(f"Expected entity `{self._name}` to have children entities")
            self._read.add(_CHILDREN)
            found = found[_CHILDREN]
        if not isinstance(found, list):
            raise TypeError(f"Expected a list of what is in `{self._name}`, got {short(found)}")
        return [Entity(one, parent=self) for one in found]

    def assert_entity_completely_parsed(self) -> None:
        if isinstance(self._element, list):
            if not self._has_read_children:
                raise ValueError(f"Unexpected list found in `{self._name}`: it has attributes only")
            return
        if not isinstance(self._element, dict):
            raise ValueError(f"Expected attributes of `{self._name}`, got {short(self._element)}")
        unknown = {str(key) for key in self._element} - self._read
        refuse_unknown("key(s)", unknown, self._name, self._asked)

    def get_attr(
        self, name: str, *, data_type: Any = str, optional: bool = False, can_be_str: bool = True
    ) -> Any:
        self._asked.add(name)
        if not isinstance(self._element, dict) or self._element.get(name) is None:
            if optional:
                self._read.add(name)
                return None
            raise AttributeError(
                f"Attribute '{name}' of type '{name_of(data_type)}' not found in Entity '{self._name}'"
            )
        self._read.add(name)
        value = self._element[name]
        if is_list_of_entities(data_type):
            if not isinstance(value, list) or not all(isinstance(one, dict) for one in value):
                raise TypeError(
                    f"Attribute '{name}' of Entity '{self._name}' expected to be a list of dictionaries."
                )
            return [Entity(one, name, parent=self) for one in value]
        if data_type is str and isinstance(value, bool | int | float):
            value = str(value).lower() if isinstance(value, bool) else str(value)
        if data_type is None and isinstance(value, dict):
            raise TypeError(f"Attribute '{name}' of Entity '{self._name}' can't be a dictionary")
        if data_type is None:
            return value
        try:
            return coerce(value, data_type, can_be_str)
        except ValueError:
            raise TypeError(
                f"Attribute '{name}' of Entity '{self._name}' expected to be of type "
                f"'{name_of(data_type)}', got {short(value)}"
            ) from None
