"""Text as YAML reads it, for attributes and parameters; text that is not YAML stays text."""

from typing import Any

__all__ = ["dump", "load"]


def load(text: str) -> Any:
    import yaml  # late: most launch files need none

    try:
        return yaml.safe_load(text)
    except yaml.YAMLError:
        return text


def dump(value: Any) -> str:
    """As YAML in which all texts are quoted: readers do not agree which bare words are numbers."""
    import yaml

    class Dumper(yaml.SafeDumper):
        pass

    Dumper.add_representer(
        str, lambda dumper, text: dumper.represent_scalar("tag:yaml.org,2002:str", text, style='"')
    )
    made: str = yaml.dump(value, Dumper=Dumper, default_flow_style=False, allow_unicode=True, width=1 << 20)
    return made
