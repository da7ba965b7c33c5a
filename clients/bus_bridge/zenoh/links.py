"""The state of the user's addresses: whether each has a link, and if not, why."""

import asyncio
import os
import socket
import ssl
from collections.abc import Callable, Sequence
from contextlib import suppress

from bus_bridge.engine import LinkStatus
from bus_bridge.zenoh.options import Address, ZenohOptions, parse_address
from bus_bridge.zenoh.session import Link, Session

__all__ = ["Links"]

_PROBE_S = 2.0
_REFUSAL_S = 0.3
_AT_ONCE = 4
"""Number of addresses that are tried at the same time. Fewer than the threads that resolve names."""
_PATIENCE = 3
"""Number of checks in a row without a link before the user gets a message."""


class Links:
    """The links of the user's addresses. Call `look` about once a second."""

    def __init__(
        self,
        options: ZenohOptions,
        session: Session,
        warn: Callable[[str], None],
        *,
        wants_routers: bool = False,
    ) -> None:
        """`wants_routers`: routers may answer at the addresses to connect to."""
        self._wants_routers = wants_routers
        self._options = options
        self._session = session
        self._warn = warn
        self._listen = [parse_address(text) for text in options.listen]
        self._flag = "--router" if options.router else "--connect"
        self._connect = [parse_address(text) for text in options.router or options.connect]
        self._resolved: dict[str, frozenset[str]] = {}
        self._missed: dict[str, int] = {}
        self._answered: set[str] = set()
        """Addresses that were reachable at the last attempt, but had no link."""
        self._reasons: dict[str, str] = {}

    async def check(self) -> None:
        """Find the reason for each missing link, and report each reason once."""
        links = self._session.links()
        due = list[Address]()
        for address in self._connect:
            if (link := self._find(address, links)) is not None:
                self._missed[address.text] = 0
                self._answered.discard(address.text)
                self._reasons.pop(address.text, None)
                if (
                    not self._wants_routers
                    and not self._options.router
                    and link.zenoh_id in self._session.routers()
                ):
                    self._warn(
                        f"--connect {address.text}: that is a router of zenoh, not a bridge; to reach "
                        f"others through it, use --router {address.text}"
                    )
                continue
            if self._options.router and links:  # one router is enough
                continue
            missed = self._missed[address.text] = self._missed.get(address.text, 0) + 1
            if missed % _PATIENCE == 0:
                due.append(address)
        few = asyncio.Semaphore(_AT_ONCE)
        reasons = await asyncio.gather(*(self._probe(address, few) for address in due))
        for address, reason in zip(due, reasons, strict=True):
            self._reasons.pop(address.text, None)
            if reason:
                self._answered.discard(address.text)
            elif address.text not in self._answered:
                self._answered.add(address.text)  # zenoh tries again within a second
            elif not self._is_joined(address, links):
                is_router = self._options.router or self._wants_routers
                who = "router of zenoh" if is_router else "bridge of busd"
                reason = f"a program listens there, but not a {who} that accepts this one"
            if reason:
                self._reasons[address.text] = reason
                self._warn(f"{self._flag} {address.text}: {reason}; still trying")

    def status(self, buses: Sequence[tuple[str, str, str]]) -> list[LinkStatus]:
        """The state of each of the user's addresses, then of each bus without such an address, or behind a
        router.

        `buses`: id, zenoh id and refusal of each.
        """
        links = self._session.links()
        known = {zenoh_id: (bus, refusal) for bus, zenoh_id, refusal in buses}
        found = [LinkStatus(one.text, "up", text="listening") for one in self._listen]
        for address in self._connect:
            link = self._find(address, links)
            if link is not None and link.zenoh_id not in known:
                is_router = link.zenoh_id in self._session.routers()
                found.append(LinkStatus(address.text, "up", text="a router" if is_router else ""))
            elif link is not None:
                bus, refusal = known.pop(link.zenoh_id)
                found.append(LinkStatus(address.text, "refused" if refusal else "up", bus, refusal))
            elif self._options.router and links:
                found.append(LinkStatus(address.text, "spare"))
            elif address.text not in self._reasons and self._is_joined(address, links):
                found.append(LinkStatus(address.text, "up", text="by another link"))
            else:
                found.append(LinkStatus(address.text, "trying", text=self._reasons.get(address.text, "")))
        where = {link.zenoh_id: link.dst for link in links}
        router = "by a router" if self._options.router else ""
        for zenoh_id, (bus, refusal) in known.items():
            place = where.get(zenoh_id, router)
            found.append(LinkStatus(place, "refused" if refusal else "up", bus, refusal))
        return found

    def _find(self, address: Address, links: Sequence[Link]) -> Link | None:
        places = self._resolved.get(address.text) or frozenset((_place(address.host, address.port),))
        for link in links:
            protocol, _, place = link.dst.partition("?")[0].partition("#")[0].partition("/")
            if protocol == address.protocol and place in places:
                return link
        return None

    def _is_joined(self, address: Address, links: Sequence[Link]) -> bool:
        """Whether there is another link to the same machine: zenoh makes only one between two bridges."""
        places = self._resolved.get(address.text, frozenset())
        hosts = {place.rpartition(":")[0] for place in places}
        return any(link.dst.partition("/")[2].rpartition(":")[0] in hosts for link in links)

    async def _probe(self, address: Address, few: asyncio.Semaphore) -> str:
        """Try to reach an address; returns the error, or "" if it is reachable."""
        loop = asyncio.get_running_loop()
        try:
            async with few, asyncio.timeout(_PROBE_S):
                found = await loop.getaddrinfo(address.host, address.port, type=socket.SOCK_STREAM)
                self._resolved[address.text] = frozenset(_place(one[4][0], one[4][1]) for one in found)
                if address.protocol == "quic":
                    return "no answer"
                context = self._context() if address.protocol == "tls" else None
                reader, writer = await asyncio.open_connection(address.host, address.port, ssl=context)
                try:
                    if await self._is_closed_at_once(reader):
                        # For example, ssh does so for a forwarded port if nothing listens at the other end.
                        return "it accepts connections and closes them at once: a tunnel without a bridge?"
                finally:
                    writer.close()
        except TimeoutError:
            return "no answer"
        except (socket.gaierror, UnicodeError):  # UnicodeError: a part of the name is too long
            return f"the host '{address.host}' is unknown"
        except ssl.SSLCertVerificationError as error:
            return f"its certificate is not valid here: {error.verify_message}"
        except ssl.SSLError as error:
            reason = (error.reason or str(error)).lower().replace("_", " ")
            if "alert" in reason:
                what = reason.partition("alert ")[2]
                return f"it does not accept --certificate {self._options.certificate}: {what}"
            return f"no TLS: {reason}"
        except OSError as error:
            return os.strerror(error.errno).lower() if error.errno else str(error)
        return ""

    async def _is_closed_at_once(self, reader: asyncio.StreamReader) -> bool:
        """Whether the other side closes the connection at once. Raises its error after the handshake if it
        refuses our certificate."""
        with suppress(TimeoutError):
            async with asyncio.timeout(_REFUSAL_S):
                return not await reader.read(1)
        return False

    def _context(self) -> ssl.SSLContext:
        context = ssl.create_default_context(cafile=self._options.ca)
        context.load_cert_chain(self._options.certificate, self._options.key)
        return context


def _place(host: object, port: object) -> str:
    return f"[{host}]:{port}" if ":" in str(host) else f"{host}:{port}"
