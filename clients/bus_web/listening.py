"""Sockets that listen, at a place of this machine."""

import errno
import os
import socket
import stat
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bus_web.place import Place

__all__ = ["ListenError", "listening"]

_BACKLOG = 256
_PROBE_S = 1.0


class ListenError(Exception):
    """Nothing can listen there; the text says why."""


@contextmanager
def listening(place: Place) -> Iterator[tuple[socket.socket, Place]]:
    """A socket that listens at `place`, and the place, with the port that the kernel chose.

    Raises ListenError. A unix socket has mode 0600. A unix socket without a listener is taken over. In the
    end the socket is closed, and its path is gone.
    """
    with socket.socket(_family(place), socket.SOCK_STREAM) as listener:
        try:
            if place.path is not None:
                _bind_unix(listener, place.path)
            else:
                listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
                listener.bind((place.address, place.port))
            listener.listen(_BACKLOG)
        except OSError as error:
            is_taken = error.errno == errno.EADDRINUSE and place.path is None
            hint = "; choose another port with --listen" if is_taken else ""
            raise ListenError(f"can't listen on {place}: {error.strerror}{hint}") from None
        made = place.path.lstat() if place.path is not None else None
        try:
            yield (
                listener,
                place if place.path is not None else place._replace(port=listener.getsockname()[1]),
            )
        finally:
            if place.path is not None and made is not None:
                _take_away(place.path, made)


def _family(place: Place) -> socket.AddressFamily:
    if place.path is not None:
        return socket.AF_UNIX
    return socket.AF_INET6 if ":" in place.address else socket.AF_INET


def _bind_unix(listener: socket.socket, path: Path) -> None:
    _clear(path)
    mask = os.umask(0o177)
    try:
        listener.bind(str(path))
    finally:
        os.umask(mask)


def _clear(path: Path) -> None:
    try:
        kind = path.lstat().st_mode
    except FileNotFoundError:
        return
    if not stat.S_ISSOCK(kind):
        raise ListenError(f"can't listen on unix:{path}: it is not a socket")
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as probe:
        probe.settimeout(_PROBE_S)
        try:
            probe.connect(str(path))
        except (TimeoutError, BlockingIOError):  # so many wait for an answer that we may not even wait
            pass
        except ConnectionRefusedError:
            with suppress(FileNotFoundError):
                path.unlink()
            return
    raise ListenError(f"can't listen on unix:{path}: another process uses it")


def _take_away(path: Path, made: os.stat_result) -> None:
    """Remove our socket, but not another file put in its place."""
    with suppress(OSError):
        if os.path.samestat(path.lstat(), made):
            path.unlink()
