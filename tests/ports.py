"""Addresses that no other test uses: ports of loopback for late servers, domains of DDS."""

import os
import random
import socket
from functools import cache

__all__ = ["free_port", "own_domain"]

_FIRST, _LAST = 15_000, 32_000
"""Limits of the ports.

They are below the range from which the kernel gives ports on request: no other program takes one in between.
And a client that connects before its server listens is not given the same port, so it can't connect to
itself.
"""
_DOMAINS = range(1, 100)
"""Domains with all ports below that, too."""
_random = random.SystemRandom()
_given: set[int] = set()


def free_port() -> int:
    """A port of loopback without a server now; each is returned only once."""
    while True:
        port = _random.randrange(_FIRST, _LAST)
        with socket.socket() as probe:
            try:
                probe.bind(("127.0.0.1", port))
            except OSError:
                continue
        if port not in _given:
            _given.add(port)
            return port


@cache
def own_domain() -> int:
    """A domain of DDS that no other test process on this machine has, until the end of this process."""
    for domain in _DOMAINS:
        claim = socket.socket(socket.AF_UNIX)
        try:
            claim.bind(f"\0busd-tests-domain-{domain}")
        except OSError:
            claim.close()
            continue
        _claims.append(claim)
        return domain
    raise RuntimeError(f"all domains are taken: {os.getpid()} found none")


_claims: list[socket.socket] = []
