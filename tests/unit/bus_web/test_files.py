"""The page's files: all exist and are small. Third-party files are unchanged."""

import re
from hashlib import sha256

from bus_web.files import PAGE, load, security_headers

FILES = load()
MOST_BYTES = 200 << 10
INLINE = re.compile(r"<script(?![^>]*\bsrc=)|<style|\bstyle=|\bon\w+=|javascript:", re.IGNORECASE)
ELSEWHERE = re.compile(r"https?://(?!www\.w3\.org/2000/svg)|@import|\burl\((?!#)")


def test_all_is_there_and_small() -> None:
    assert {
        "/",
        "/page.js",
        "/style.css",
        "/icon.svg",
        "/vendor/dagre.min.js",
        "/vendor/uplot.min.js",
    } <= FILES.keys()
    assert "/index.html" not in FILES
    assert sum(len(file.body) for file in FILES.values()) < MOST_BYTES


def test_nothing_stands_inline_and_nothing_comes_from_elsewhere() -> None:
    ours = {path: file.body.decode() for path, file in FILES.items() if not path.startswith("/vendor/")}
    assert [path for path, text in ours.items() if ELSEWHERE.search(text)] == []
    assert not INLINE.search(ours["/"])


def test_the_page_writes_no_html() -> None:
    """The page shows foreign values as text nodes."""
    writers = re.compile(
        r"innerHTML|outerHTML|insertAdjacentHTML|document\.write|\beval\(|new Function|srcdoc"
    )
    ours = [path for path in PAGE.glob("*.js") if writers.search(path.read_text())]
    assert ours == []


def test_all_that_the_page_asks_for_is_there() -> None:
    asked = re.findall(r'(?:src|href)="([^"#]+)"', FILES["/"].body.decode())
    for path in PAGE.glob("*.js"):
        asked += [f"{name}" for name in re.findall(r'from "\./([^"]+)"', path.read_text())]
    assert {f"/{name}" for name in asked} <= FILES.keys()


def test_those_of_others_are_as_they_were_published() -> None:
    lines = (PAGE / "vendor" / "versions.txt").read_text().splitlines()
    told = {name: digest for digest, name in (line.split()[:2] for line in lines if not line.startswith("#"))}
    there = {path.name: sha256(path.read_bytes()).hexdigest() for path in (PAGE / "vendor").iterdir()}
    there.pop("versions.txt")
    assert told == there, "`make vendor` writes both"
    assert {name for name in there if name.endswith("LICENSE.txt")} == {
        "dagre.LICENSE.txt",
        "uplot.LICENSE.txt",
    }


def test_what_a_page_may_load() -> None:
    headers = security_headers("localhost:1")
    policy = headers["Content-Security-Policy"]
    assert "default-src 'none'" in policy
    assert "unsafe" not in policy
    assert "frame-ancestors 'none'" in policy
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert not any(name.startswith("Access-Control") for name in headers)
