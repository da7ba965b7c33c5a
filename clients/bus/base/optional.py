"""Commands to install packages that parts of busd need and that a plain install leaves out."""

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
"""Distributions and their versions, equal to the extras in pyproject.toml."""


def how_to_install(distribution: str) -> str:
    """The command, for a shell.

    It names the package itself and not an extra of busd (`busd[web]`). A command with an extra depends on the
    source of busd: a clone, a wheel or an index. This command works with each of them, in any folder.
    """
    return f"pip install '{distribution}{BOUNDS[distribution]}'"
