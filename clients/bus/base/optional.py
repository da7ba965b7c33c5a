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
    "xxhash": ">=3,<5",
}
"""Distributions and their versions, equal to the extras in pyproject.toml."""


def how_to_install(*distributions: str) -> str:
    """The command, for a shell.

    It names the packages themselves and not an extra of busd (`busd[web]`). A command with an extra depends
    on the source of busd: a clone, a wheel or an index. This command works with each of them, in any folder.
    """
    packages = " ".join(f"'{one}{BOUNDS[one]}'" for one in distributions)
    return f"pip install {packages}"
