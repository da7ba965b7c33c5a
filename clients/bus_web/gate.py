"""Access check: by the request's name for this machine, the page that sent it, and a token.

Pure: a request goes in, a decision comes out. A browser runs pages of any origin. Such a page may ask for
addresses of this machine: then Origin names the page. Or its owner points a name to this machine, and it asks
for that name: then Host has the name. It knows no token. Other users of the machine know none either.
"""

import hmac
import ipaddress
from collections.abc import Iterable, Sequence
from typing import NamedTuple
from urllib.parse import parse_qs, urlsplit

__all__ = ["FOXGLOVE", "Ask", "Enter", "Gate", "Redirect", "Refuse"]

FOXGLOVE = "https://app.foxglove.dev"
"""The page of Foxglove, which may open connections; it needs the token like all others."""


class Ask(NamedTuple):
    """A request. Each header has all its values, so a repeated header is visible."""

    target: str
    """Path and query, as they came."""
    method: str = "GET"
    host: Sequence[str] = ()
    origin: Sequence[str] = ()
    cookie: Sequence[str] = ()


class Enter(NamedTuple):
    """It may have the content of `path`; `host` is its name for this machine."""

    path: str
    host: str


class Redirect(NamedTuple):
    """It has the token in its address. From now on, a cookie must have the token."""

    location: str
    cookie: str


class Refuse(NamedTuple):
    """It gets nothing but this status of HTTP, and a sentence."""

    status: int
    text: str


class Gate:
    """`token` opens it, as `?token=` or in the `cookie`. Pages of `origins` may connect, too."""

    def __init__(self, token: str, cookie: str, origins: Iterable[str] = ()) -> None:
        self._token = token.encode()
        self._cookie = cookie
        self._origins = frozenset(origin.rstrip("/").lower() for origin in (FOXGLOVE, *origins))
        self._tickets: set[str] = set()

    def issue(self, ticket: str) -> None:
        """A page may be opened by `ticket` in place of the token, once."""
        self._tickets.add(ticket)

    def judge(self, ask: Ask, *, is_socket: bool) -> Enter | Redirect | Refuse:
        """`is_socket`: it asks for a WebSocket, which can't be redirected."""
        if ask.method != "GET":
            return Refuse(405, "only GET is allowed here")
        host = ask.host[0].lower() if len(ask.host) == 1 else ""
        if not _is_loopback(host):
            return Refuse(403, "use localhost or 127.0.0.1: requests by another host name are refused")
        if not self._may_come(ask.origin, host):
            return Refuse(403, "pages of other origins have no access (see --allow-origin)")
        try:
            parts = urlsplit(ask.target)
            given = parse_qs(parts.query, keep_blank_values=True, max_num_fields=20).get("token")
        except ValueError:
            return Refuse(400, "the address of the request is malformed")
        if given is None:
            if any(self._is_token(one) for one in self._cookies(ask.cookie)):
                return Enter(parts.path, host)
            return Refuse(403, "open the address that the server has printed: its token is new at each start")
        if len(given) == 1 and given[0] in self._tickets and not is_socket:
            self._tickets.discard(given[0])
        elif not all(self._is_token(one) for one in given):
            return Refuse(
                403, "this token is from an earlier start: open the address that the server has printed"
            )
        if is_socket:
            return Enter(parts.path, host)
        cookie = f"{self._cookie}={self._token.decode()}; Path=/; HttpOnly; SameSite=Strict"
        return Redirect("/", cookie)

    def _may_come(self, origin: Sequence[str], host: str) -> bool:
        """Allows pages of this server, the named origins, and requests without an origin."""
        if not origin:
            return True
        given = origin[0].lower()
        return len(origin) == 1 and (given == f"http://{host}" or given in self._origins)

    def _cookies(self, headers: Sequence[str]) -> list[str]:
        """Values of our cookies. Browsers send cookies of all servers on this machine, in any format."""
        pairs = (one.strip().partition("=") for header in headers for one in header.split(";"))
        return [value for name, _, value in pairs if name == self._cookie]

    def _is_token(self, given: str) -> bool:
        return hmac.compare_digest(given.encode(errors="surrogateescape"), self._token)


def _is_loopback(host: str) -> bool:
    """Whether a header Host is a name of loopback, with any port: ssh may forward another port."""
    name, colon, port = host.rpartition(":")
    if not colon or (host.startswith("[") and host.endswith("]")):
        name, port = host, ""
    if port and not (port.isascii() and port.isdigit() and len(port) < 6):
        return False
    if name == "localhost":
        return True
    is_bracketed = name.startswith("[") and name.endswith("]")
    try:
        address = ipaddress.ip_address(name[1:-1] if is_bracketed else name)
    except ValueError:
        return False
    return address.is_loopback and (address.version == 6) == is_bracketed and "%" not in name
