"""Values that `bus param` sends, without a bus."""

from typing import Any, cast

from bus.parameters.values import ParameterType
from bus.types.classes import message_class, service_class
from bus_cli.param.remote import Remote


class Node(Remote):
    """Parameters of a node that is no program: the declared types, and the values that were set."""

    def __init__(self, **declared: int) -> None:
        super().__init__(cast(Any, None), "/node")
        self.declared = declared
        self.got: dict[str, Any] = {}

    async def call(self, service: str, **fields: Any) -> Any:
        response = cast(Any, service_class(f"rcl_interfaces/srv/{service}")).Response()
        if service == "DescribeParameters":
            make = cast(Any, message_class("rcl_interfaces/msg/ParameterDescriptor"))
            # As a node of rclcpp: nothing about undeclared parameters.
            wanted = set(fields["names"]) & self.declared.keys()
            response.descriptors = [make(name=name, type=self.declared[name]) for name in sorted(wanted)]
        else:
            self.got |= {one.name: one.value for one in fields["parameters"]}
            response.results = [None] * len(fields["parameters"])
        return response


async def test_an_empty_list_has_the_declared_type() -> None:
    lists = {type_.name.lower(): int(type_) for type_ in ParameterType if type_.is_array}
    node = Node(**lists, text=4, strange=77)
    await node.set({**{name: [] for name in (*lists, "text", "strange", "absent")}, "full": [1]})
    assert {name: value.type for name, value in node.got.items()} == {
        **lists,
        **dict.fromkeys(("text", "strange", "absent"), ParameterType.BOOL_ARRAY),
        "full": ParameterType.INTEGER_ARRAY,
    }
