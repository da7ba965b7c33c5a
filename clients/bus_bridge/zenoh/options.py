"""The user's options for the engine for zenoh, checked before anything is opened. Only reads files."""

import ipaddress
import ssl
from pathlib import Path

import msgspec

from bus_bridge.errors import BridgeError
from bus_bridge.zenoh.groups import MOST_SEEN, Groups

__all__ = ["Address", "ZenohOptions", "check", "parse_address"]

_PROTOCOLS = ("tcp", "tls", "quic")
_PROTECTED = ("tls", "quic")
_LOCAL_NAMES = ("localhost", "ip6-localhost")


class ZenohOptions(msgspec.Struct, frozen=True, kw_only=True):
    """Addresses are `tls/HOST:PORT`, `quic/HOST:PORT` or `tcp/HOST:PORT`."""

    listen: tuple[str, ...] = ()
    connect: tuple[str, ...] = ()
    router: tuple[str, ...] = ()
    """Addresses of routers (zenohd). One of them is used, instead of `listen` and `connect`."""
    ca: str = ""
    """File with the certificates (PEM) of the authorities that this side trusts."""
    certificate: str = ""
    """File with this side's own certificate (PEM). Both kinds of peers get it: peers that this side connects
    to, and peers that connect."""
    key: str = ""
    """File with the private key of `certificate`."""
    insecure: bool = False
    """Addresses other than loopback may work without certificates."""
    compression: bool = False
    """zenoh compresses the data on a link (LZ4), if the other side has this set, too."""
    groups: Groups = Groups()
    """The group of this bus, and the groups that it sees."""


class Address(msgspec.Struct, frozen=True):
    text: str
    protocol: str
    host: str
    port: int

    @property
    def is_loopback(self) -> bool:
        if self.host in _LOCAL_NAMES:
            return True
        try:
            return ipaddress.ip_address(self.host).is_loopback
        except ValueError:
            return False

    @property
    def is_protected(self) -> bool:
        return self.protocol in _PROTECTED


def parse_address(text: str) -> Address:
    """Read an address. Raises BridgeError if the text is not one."""
    protocol, slash, rest = text.partition("/")
    if not slash or protocol not in _PROTOCOLS:
        meant = text.rpartition("/")[2] or "HOST:PORT"
        raise BridgeError(f"address '{text}' must begin with tls/, quic/ or tcp/: tls/{meant}")
    host, colon, port = rest.rpartition(":")
    bare = host[1:-1] if host[:1] == "[" and host[-1:] == "]" else host
    if not colon or not bare or (":" in bare and bare == host):
        raise BridgeError(f"address '{text}' must end with a host and a port, as {protocol}/robot.local:7447")
    if not port.isascii() or not port.isdecimal() or not 1 <= int(port) <= 65535:
        raise BridgeError(f"address '{text}' has port '{port}'; ports are from 1 to 65535")
    if any(letter in bare for letter in "/#?;*$ ") or not bare.isprintable():
        raise BridgeError(f"address '{text}' has a host with an invalid character")
    return Address(text, protocol, bare, int(port))


def check(options: ZenohOptions) -> list[str]:
    """Check the options. Raises BridgeError for impossible or forbidden ones; returns warnings for the
    user."""
    if options.router and (options.listen or options.connect):
        other = "--listen" if options.listen else "--connect"
        raise BridgeError(
            f"--router and {other} can't be given together: a bridge uses either a router, or direct links "
            "to other bridges"
        )
    if len(options.groups.seen) > MOST_SEEN:
        raise BridgeError(f"--see has {len(options.groups.seen)} groups; at most {MOST_SEEN} are allowed")
    addresses = [(parse_address(text), "--listen") for text in options.listen]
    addresses += [(parse_address(text), "--connect") for text in options.connect]
    addresses += [(parse_address(text), "--router") for text in options.router]
    warnings = []
    if not addresses:
        warnings.append("none of --listen, --connect and --router is given: no other bridge can be reached")
    is_protected = False
    for address, flag in addresses:
        if address.is_protected:
            is_protected = True
            missing = [name for name in ("ca", "certificate", "key") if not getattr(options, name)]
            if missing:
                flags = ", ".join(f"--{name} FILE" for name in missing)
                verb = "is" if len(missing) == 1 else "are"
                raise BridgeError(
                    f"{flag} {address.text} needs certificates for both sides: {flags} {verb} missing"
                )
        elif not address.is_loopback:
            if not options.insecure:
                raise BridgeError(
                    f"{flag} {address.text} is not protected, and other machines can reach it: use tls/ with "
                    "certificates, or --insecure if all programs that reach it may read and publish"
                )
            warnings.append(
                f"{flag} {address.text} is not protected: any program that reaches it can read and publish"
            )
    if is_protected:
        _check_files(options)
    return warnings


def _check_files(options: ZenohOptions) -> None:
    for flag, name in (("--ca", options.ca), ("--certificate", options.certificate), ("--key", options.key)):
        try:
            Path(name).read_bytes()
        except OSError as error:
            raise BridgeError(f"{flag} {name}: {error.strerror}") from None
    context = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
    for flag, name in (("--ca", options.ca), ("--certificate", options.certificate)):
        try:
            context.load_verify_locations(name)
        except (ssl.SSLError, OSError):
            raise BridgeError(f"{flag} {name} has no certificate in PEM") from None
    try:
        context.load_cert_chain(options.certificate, options.key, password="")
    except (ssl.SSLError, OSError) as error:
        what = (
            "does not belong to" if "MISMATCH" in str(error) else "is not a private key (PEM, no password) of"
        )
        raise BridgeError(f"--key {options.key} {what} --certificate {options.certificate}") from None
