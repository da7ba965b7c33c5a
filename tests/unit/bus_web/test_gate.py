"""Access: hosts, origins, tokens, cookies."""

from bus_web.gate import FOXGLOVE, Ask, Enter, Gate, Redirect, Refuse
from rows import for_each

TOKEN = "s3cret-token"
GATE = Gate(TOKEN, "busd_1", ["http://localhost:9999"])
HOST = ("127.0.0.1:8765",)
COOKIE = (f"other=1; busd_1={TOKEN}",)


def judge(target: str = "/", *, is_socket: bool = False, **headers: object) -> Enter | Redirect | Refuse:
    given = {"host": HOST, "cookie": COOKIE, **headers}
    return GATE.judge(Ask(target, **given), is_socket=is_socket)  # type: ignore[arg-type]


def status(decision: Enter | Redirect | Refuse) -> int:
    return decision.status if isinstance(decision, Refuse) else 200


@for_each(
    "host",
    ["127.0.0.1", "127.0.0.1:8765", "localhost", "LOCALHOST:9", "[::1]", "[::1]:8765", "127.8.9.1:1"],
)
def test_names_of_loopback(host: str) -> None:
    assert judge(host=(host,)) == Enter("/", host.lower())


@for_each(
    "host",
    [
        (), ("",), ("evil.example",), ("evil.example:8765",), ("localhost.evil.example",),
        ("127.0.0.1.nip.io",), ("10.0.0.1:8765",), ("0.0.0.0:8765",), ("[::]:8765",), ("::1",),
        ("[127.0.0.1]",), ("[::1%lo]",),
        ("localhost:x",), ("localhost:123456",), ("a@127.0.0.1",), ("2130706433",), ("127.1",),
        ("127.0.0.1:8765", "127.0.0.1:8765"), ("localhost", "evil.example"),
    ],
)  # fmt: skip
def test_other_names_are_refused(host: tuple[str, ...]) -> None:
    assert status(judge(host=host)) == 403
    assert status(judge(f"/?token={TOKEN}", host=host, is_socket=True)) == 403


@for_each(
    "origin",
    [(), ("http://127.0.0.1:8765",), (FOXGLOVE,), ("http://localhost:9999",), ("HTTP://LOCALHOST:9999",)],
)
def test_pages_that_may_come(origin: tuple[str, ...]) -> None:
    assert judge(origin=origin) == Enter("/", HOST[0])


@for_each(
    "origin",
    [
        ("",), ("null",), ("http://evil.example",), ("https://127.0.0.1:8765",), ("http://127.0.0.1:3000",),
        ("http://127.0.0.1",), ("http://localhost:8765",), ("https://app.foxglove.dev.evil.example",),
        ("http://app.foxglove.dev",), ("http://127.0.0.1:8765", "http://evil.example"),
    ],
)  # fmt: skip
def test_pages_of_others_are_refused(origin: tuple[str, ...]) -> None:
    for is_socket in (False, True):
        assert status(judge(f"/?token={TOKEN}", origin=origin, is_socket=is_socket)) == 403


def test_the_token_goes_into_a_cookie_and_out_of_the_address() -> None:
    decision = judge(f"/?token={TOKEN}", cookie=())
    assert decision == Redirect("/", f"busd_1={TOKEN}; Path=/; HttpOnly; SameSite=Strict")


def test_a_ticket_opens_once() -> None:
    gate = Gate(TOKEN, "busd_1")
    gate.issue("for-once")
    ask = Ask("/?token=for-once", host=HOST)
    assert status(gate.judge(ask, is_socket=True)) == 403
    assert gate.judge(ask, is_socket=False) == Redirect(
        "/", f"busd_1={TOKEN}; Path=/; HttpOnly; SameSite=Strict"
    )
    assert status(gate.judge(ask, is_socket=False)) == 403


def test_a_websocket_goes_by_no_redirect() -> None:
    assert judge(f"/?token={TOKEN}", cookie=(), is_socket=True) == Enter("/", HOST[0])
    assert judge("/", is_socket=True) == Enter("/", HOST[0])


@for_each(
    ("target", "cookie"),
    [
        ("/", ()), ("/?token=", ()), ("/?token=wrong", ()), (f"/?token={TOKEN}x", ()),
        (f"/?TOKEN={TOKEN}", ()), (f"/?token={TOKEN}&token=wrong", ()),
        ("/?token=wrong", COOKIE), ("/?token=%ff", ()),
        ("/", ("busd_1=wrong",)), ("/", (f"busd_2={TOKEN}",)), ("/", ("=;;\x00",)), (f"/{TOKEN}", ()),
        (f"/#token={TOKEN}", ()),
    ],
)  # fmt: skip
def test_without_the_token_nothing_is_had(target: str, cookie: tuple[str, ...]) -> None:
    for is_socket in (False, True):
        assert status(judge(target, cookie=cookie, is_socket=is_socket)) == 403


@for_each(
    "others",
    [
        'state={"a":1}',
        "a[0]=1",
        'a="unfinished',
        "=",
        "no value",
        "busd_1=of an earlier start",
        "ü=ü",
        "a=,b=1",
    ],
)
def test_cookies_of_other_servers_keep_nobody_out(others: str) -> None:
    """Browsers send the cookies of all ports of this machine."""
    for cookie in (f"{others}; busd_1={TOKEN}", f"busd_1={TOKEN}; {others}", f"busd_1={TOKEN};{others}"):
        assert judge(cookie=(cookie,)) == Enter("/", HOST[0])


@for_each("target", ["//[", "/?" + "&".join(["a=1"] * 50)])
def test_what_is_no_address(target: str) -> None:
    assert status(judge(target)) in (400, 403)


@for_each("method", ["HEAD", "POST", "PUT", "DELETE", "OPTIONS", "CONNECT", ""])
def test_nothing_but_get(method: str) -> None:
    assert status(judge(method=method)) == 405


def test_paths_come_through_as_they_are() -> None:
    assert judge("/vendor/../../etc/passwd?x=1") == Enter("/vendor/../../etc/passwd", HOST[0])
