"""bus.release says what is packaged."""

import tomllib
from pathlib import Path

from bus.release import RELEASE


def test_as_the_package_says() -> None:
    project = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
    assert project["project"]["version"] == RELEASE
