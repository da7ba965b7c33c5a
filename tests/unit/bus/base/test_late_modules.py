"""asyncio and uvloop without TLS, `inspect` and the like: they are loaded if a program asks for them."""

import subprocess
import sys
from pathlib import Path

import pytest

from bus.runner import loop_factory
from rows import for_each

_LEAN = """
from bus.base.loading import loading
import sys
with loading(): import asyncio
"""
_ON_UVLOOP = """
import sys, bus
from bus.base.loading import loading
with loading(): import asyncio

async def main():
    assert type(asyncio.get_running_loop()).__module__ == "uvloop"
    assert not {"ast", "base64", "token", "_posixsubprocess"} & set(sys.modules)
    await use()

bus.run(main())
"""
_NOT_LOADED = "assert '_ssl' not in sys.modules and 'ast' not in sys.modules\n"


def _run(code: str) -> None:
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@for_each(
    "use",
    [
        "assert asyncio.sslproto.SSLProtocol and asyncio.base_events.ssl.SSLContext",
        "import ssl; ssl.create_default_context()",
        "from ssl import SSLContext, SSLError",
        "from ssl import *; SSLContext",
        "import inspect; assert inspect.signature(len) and type(inspect) is type(sys)",
        "import ssl; assert 'SSLContext' in dir(ssl)",
        "import ssl; ssl.SSLContext = 1; assert ssl.SSLContext == 1 and ssl.SSLError",
        "import inspect, importlib; assert importlib.reload(inspect).signature",
        "import inspect; assert inspect.iscoroutinefunction(asyncio.sleep)",
        "import subprocess as s; assert s.run is not None and (s.PIPE, s.STDOUT, s.DEVNULL) == (-1, -2, -3)",
        "import platform; assert platform.system() == platform.uname().system and platform.machine()",
        "import linecache, bus; assert linecache.getline(bus.__file__, 1)",
        "import ssl, pickle; assert pickle.loads(pickle.dumps(ssl.SSLError)) is ssl.SSLError",
    ],
)
def test_late_modules_are_as_any_other(use: str) -> None:
    _run(f"{_LEAN}assert asyncio.run\n{_NOT_LOADED}{use}\n")


def test_an_unknown_name_is_an_attribute_error() -> None:
    _run(
        f"{_LEAN}import ssl\ntry: ssl.nothing\n"
        "except AttributeError as error: assert str(error) == \"module 'ssl' has no attribute 'nothing'\"\n"
        "else: raise SystemExit('no error')"
    )


def test_threads_wait_until_it_is_loaded() -> None:
    _run(
        f"{_LEAN}import ssl, threading\nsys.setswitchinterval(1e-6)\nfound, go = [], threading.Barrier(8)\n"
        "def ask(): go.wait(); found.append(ssl.get_protocol_name(ssl.PROTOCOL_TLS))\n"
        "threads = [threading.Thread(target=ask) for _ in range(8)]\n"
        "for one in threads: one.start()\n"
        "for one in threads: one.join()\n"
        "assert found == ['PROTOCOL_TLS'] * 8, found"
    )


_HALF_LOADED = """
import threading
def early(): return later()
threading.begun.set()
threading.tried.wait(0.2)  # until a thread has called `early`, if it does not wait
def later(): return "done"
"""


def test_a_thread_does_not_see_a_half_loaded_module(tmp_path: Path) -> None:
    (tmp_path / "textwrap.py").write_text(_HALF_LOADED)
    _run(
        "import threading\nthreading.begun, threading.tried = threading.Event(), threading.Event()\n"
        f"{_LEAN}sys.modules.pop('textwrap', None)\nsys.path.insert(0, {str(tmp_path)!r})\n"
        "with loading(): import textwrap\n"
        "loader = threading.Thread(target=lambda: textwrap.later())\nloader.start()\n"
        "threading.begun.wait()\n"
        "try: assert textwrap.early() == 'done'\nfinally: threading.tried.set()\n"
        "loader.join()\nassert type(textwrap) is type(sys)"
    )


def test_what_is_imported_already_stays() -> None:
    _run(f"import ssl, asyncio\nbefore = vars(ssl)['SSLContext']\n{_LEAN}assert ssl.SSLContext is before")


def test_a_python_without_tls_says_so_at_once() -> None:
    _run(
        "import bus; from importlib.machinery import PathFinder as P; find = P.find_spec\n"
        "P.find_spec = lambda name, *more: None if name in ('_ssl', 'ssl') else find(name, *more)\n"
        f"{_LEAN}assert asyncio.base_events.ssl is None"
    )


def test_loading_that_fails_is_tried_again() -> None:
    _run(
        f"{_LEAN}import ssl\nsys.modules['_ssl'] = None\n"
        "try: ssl.SSLContext\nexcept ImportError: pass\nelse: raise SystemExit('no error')\n"
        "del sys.modules['_ssl']\nassert ssl.SSLContext"
    )


@pytest.mark.skipif(loop_factory() is None, reason="no uvloop here")
@for_each(
    "use",
    [
        """
    import ssl
    ends = []
    for protocol in (ssl.PROTOCOL_TLS_SERVER, ssl.PROTOCOL_TLS_CLIENT):
        end = ssl.SSLContext(protocol)
        end.check_hostname, end.verify_mode = False, ssl.CERT_NONE
        end.maximum_version = ssl.TLSVersion.TLSv1_2
        end.set_ciphers("aNULL:@SECLEVEL=0")  # without certificates
        ends.append(end)

    async def echo(reader, writer):
        writer.write(await reader.readline())
        writer.close()

    async with await asyncio.start_server(echo, "127.0.0.1", 0, ssl=ends[0]) as server:
        reader, writer = await asyncio.open_connection(*server.sockets[0].getsockname(), ssl=ends[1])
        writer.write(b"hi\\n")
        assert await reader.readline() == b"hi\\n" and writer.get_extra_info("cipher")
        writer.close()
""",
        """
    try:
        await asyncio.get_running_loop().create_server(asyncio.Protocol, "127.0.0.1", 0, ssl=3)
    except TypeError as error:
        assert "SSLContext" in str(error)
    else:
        raise SystemExit("no error")
""",
        """
    def fail(): raise KeyError("here")
    pipe, echo = asyncio.subprocess.PIPE, ("echo", "hi")
    child = await asyncio.create_subprocess_exec(*echo, stdout=pipe, stderr=asyncio.subprocess.DEVNULL)
    assert await child.communicate() == (b"hi\\n", None)
    try:
        await asyncio.create_subprocess_exec(*echo, preexec_fn=fail)
    except Exception as error:
        import subprocess
        assert type(error) is subprocess.SubprocessError and type(error.__cause__) is KeyError
    else:
        raise SystemExit("no error")
""",
        """
    async def handler(): pass
    try:
        asyncio.get_running_loop().add_signal_handler(10, handler)
    except TypeError as error:
        assert "coroutines cannot be used" in str(error)
    else:
        raise SystemExit("no error")
""",
    ],
)
def test_uvloop_has_what_it_took_of_late_modules(use: str) -> None:
    _run(f"async def use():{use}\n{_ON_UVLOOP}")


def test_a_call_waits_until_a_module_is_loaded() -> None:
    _run(
        f"{_LEAN}import ssl\nfrom bus.base.late_modules import when_loaded\nfound = []\n"
        "when_loaded(ssl, lambda: found.append('SSLContext' in vars(ssl)))\nassert not found\n"
        "ssl.SSLContext\nassert found == [True]\n"
        "when_loaded(ssl, lambda: found.append(2))\nassert found == [True, 2]"
    )


@pytest.mark.skipif(sys.version_info < (3, 12), reason="functions have no such mark")
def test_a_call_to_be_awaited_is_a_coroutine_function_also_for_a_late_inspect() -> None:
    function = "bus.Node.create_publisher"
    _run(f"import bus; {function}\nimport inspect\nassert inspect.iscoroutinefunction({function})")
