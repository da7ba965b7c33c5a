"""Packages that parts of busd need and that a plain install leaves out: the command that installs one."""

__all__ = ["BOUNDS", "how_to_install"]

BOUNDS = {
    "argcomplete": ">=3",
    "cyclonedds": ">=11.0.1",
    "eclipse-zenoh": ">=1.10,<2",
    "mcap": ">=1.3,<2",
    "numpy": ">=1.26",
    "opencv-python-headless": ">=4.8",
    "prometheus-client": ">=0.20",
    "textual": ">=3",
    "websockets": ">=15",
}
"""Distributions and their versions, as the extras in pyproject.toml have them."""


def how_to_install(distribution: str) -> str:
    """The command, for a shell.

    It names the package itself and not an extra of busd (`busd[web]`), because a command with an extra
    depends on where busd came from: a clone, a wheel or an index. This one works after each, in any folder.
    """
    return f"pip install '{distribution}{BOUNDS[distribution]}'"
