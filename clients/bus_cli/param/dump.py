"""`bus param dump`: write a node's parameters as a file for `--params-file` and `bus param load`."""

from argparse import ArgumentParser, Namespace
from typing import Any

from bus.parameters.file import PARAMETERS_KEY, parse_scalar
from bus.parameters.values import SEPARATOR
from bus_cli.output import print_json, say
from bus_cli.param.remote import add_node_argument, find_node, listed, open_remote, plain
from bus_cli.stream import run_stream


def add_arguments(parser: ArgumentParser) -> None:
    add_node_argument(parser)


def main(args: Namespace) -> int:
    return run_stream(_dump(args, find_node(args, args.timeout)))


async def _dump(args: Namespace, name: str) -> int:
    async with open_remote(args, name) as remote:
        names = await remote.names()
        values = [plain(value) for value in await remote.values(names)]
    # Leave out a parameter without a value: the file has no way to write it.
    found = {key: listed(value) for key, value in zip(names, values, strict=True) if value is not None}
    if args.json:
        print_json({"node": name, "parameters": found})
    else:
        say(to_yaml({name: {PARAMETERS_KEY: nested(found)}}))
    return 0


def nested(values: dict[str, Any]) -> dict[str, Any]:
    """Put `a.b` into a mapping `a`. If `a` also has a value, YAML can't have both, and `a.b` stays whole."""
    root: dict[str, Any] = {}
    for name, value in values.items():
        *above, last = name.split(SEPARATOR)
        prefixes = [SEPARATOR.join(above[:count]) for count in range(1, len(above) + 1)]
        place = root
        if any(prefix in values for prefix in prefixes):
            last = name
        else:
            for part in above:
                place = place.setdefault(part, {})
        place[last] = value
    return root


def to_yaml(value: Any) -> str:
    """YAML in blocks with sorted keys. Quotes a text that rcl would read as another type."""
    import yaml

    from bus_cli.render import represent_text

    base: Any = yaml.SafeDumper

    class Dumper(base):  # type: ignore[misc,unused-ignore]
        def ignore_aliases(self, data: object) -> bool:
            return True

    def represent(dumper: Any, text: str) -> Any:
        is_text = isinstance(parse_scalar(text), str)
        return represent_text(dumper, text, None if is_text else "'")

    Dumper.add_representer(str, represent)
    return str(yaml.dump(value, Dumper=Dumper, default_flow_style=False, allow_unicode=True))
