"""Certificates for tests: an authority, and certificates that it has signed, made by openssl."""

import subprocess
from collections.abc import Iterable
from pathlib import Path
from typing import NamedTuple

__all__ = ["Certificates", "make_certificates"]


class Certificates(NamedTuple):
    ca: Path
    certificate: Path
    key: Path


def make_certificates(
    folder: Path, *names: str, authority: str = "ca", addresses: Iterable[str] = ()
) -> dict[str, Certificates]:
    """A certificate for each of `names`: for 127.0.0.1, localhost, ::1, `addresses` and the name itself."""
    key, ca = folder / f"{authority}.key", folder / f"{authority}.pem"
    _openssl(
        *("req", "-x509", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes", "-days", "2"),
        *("-subj", f"/CN={authority}", "-keyout", str(key), "-out", str(ca)),
        *("-addext", "basicConstraints=critical,CA:TRUE", "-addext", "keyUsage=critical,keyCertSign,cRLSign"),
    )
    made = {}
    for name in names:
        own = Certificates(ca, folder / f"{name}.pem", folder / f"{name}.key")
        request, extensions = folder / f"{name}.csr", folder / f"{name}.ext"
        extensions.write_text(
            f"subjectAltName=IP:127.0.0.1,IP:::1,IP:10.99.0.1,IP:10.99.0.2,DNS:localhost,DNS:{name}"
            f"{''.join(f',IP:{one}' for one in addresses)}\n"
            "extendedKeyUsage=serverAuth,clientAuth\n"
        )
        _openssl(
            *("req", "-newkey", "ec", "-pkeyopt", "ec_paramgen_curve:P-256", "-nodes"),
            *("-subj", f"/CN={name}", "-keyout", str(own.key), "-out", str(request)),
        )
        _openssl(
            *("x509", "-req", "-in", str(request), "-CA", str(ca), "-CAkey", str(key), "-days", "2"),
            *("-CAcreateserial", "-extfile", str(extensions), "-out", str(own.certificate)),
        )
        made[name] = own
    return made


def _openssl(*words: str) -> None:
    subprocess.run(["openssl", *words], check=True, capture_output=True, timeout=30)
