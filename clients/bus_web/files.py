"""The page's files, read once. The server has no other paths, and looks up none on the disk."""

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

__all__ = ["PAGE", "File", "load", "security_headers"]

PAGE = Path(__file__).with_name("page")

_TYPES = {
    ".html": "text/html; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".svg": "image/svg+xml",
    ".txt": "text/plain; charset=utf-8",
}
_NAMES = {"/index.html": "/"}


class File(NamedTuple):
    """A file served at a path."""

    content_type: str
    body: bytes


def load(folder: Path = PAGE) -> Mapping[str, File]:
    """All files below, by the paths at which they are served; index.html at `/`."""
    found = {}
    for path in sorted(folder.rglob("*")):
        if path.is_file() and path.suffix in _TYPES:
            name = f"/{path.relative_to(folder).as_posix()}"
            found[_NAMES.get(name, name)] = File(_TYPES[path.suffix], path.read_bytes())
    return found


def security_headers(host: str) -> dict[str, str]:
    """Headers of every answer: limit what the page may load, and forbid other pages to show or read it."""
    return {
        "Content-Security-Policy": "default-src 'none'; script-src 'self'; style-src 'self'; "
        f"img-src 'self'; connect-src 'self' ws://{host}; base-uri 'none'; form-action 'none'; "
        "frame-ancestors 'none'",
        "X-Content-Type-Options": "nosniff",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Referrer-Policy": "no-referrer",
        "Cache-Control": "no-store",
    }
