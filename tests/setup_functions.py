"""The functions of setup.py, without setuptools, which would replace distutils in this process."""

import runpy
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace
from typing import Any
from unittest.mock import patch

__all__ = ["load_setup"]

_SETUP = Path(__file__).parents[1] / "setup.py"


def load_setup() -> dict[str, Any]:
    root = ModuleType("setuptools")
    root.Extension, root.setup = SimpleNamespace, None  # type: ignore[attr-defined]
    stubs = {"setuptools": root, "setuptools.command": ModuleType("setuptools.command")}
    for name in ("bdist_wheel", "build_ext", "build_py"):
        module = stubs[f"setuptools.command.{name}"] = ModuleType(name)
        setattr(module, name, object)
    with patch.dict(sys.modules, stubs):
        return runpy.run_path(str(_SETUP), run_name="setup")
