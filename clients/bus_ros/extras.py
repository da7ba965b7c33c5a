"""Optional modules, imported at their first use."""

from importlib import import_module
from typing import Any

from bus.base.optional import how_to_install

__all__ = ["extra"]

_PACKAGES = {"cv2": ("OpenCV", "opencv-python-headless"), "numpy": ("NumPy", "numpy")}


def extra(module: str, who: str) -> Any:
    """The module, or ModuleNotFoundError with a text that says how to install it for `who`."""
    try:
        return import_module(module)
    except ModuleNotFoundError as error:
        if error.name != module:
            raise
        title, package = _PACKAGES[module]
        raise ModuleNotFoundError(f"{who} needs {title}: {how_to_install(package)}", name=module) from None
