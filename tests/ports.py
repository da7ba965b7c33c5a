"""Places that no other test has: ports of loopback for who listens late, domains of DDS."""

import os
import random
import socket
from functools import cache

__all__ = ["free_port", "own_domain"]

_FIRST, _LAST = 15_000, 32_000
"""Below what the kernel gives to whoever asks for any: nobody else takes one between now and then, and who
connects before somebody listens is not given that very port, and so connected to itself."""
_DOMAINS = range(1, 100)
"""Those whose ports are below that, too."""
_random = random.SystemRandom()
_given: set[int] = set()


def free_port() -> int:
    """A port of loopback at which nobody listens just now; none is given twice."""
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
    """A domain of DDS that no other process of tests on this machine has, to this process's end."""
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
