"""asyncio without TLS and `inspect`: both are loaded if a program asks for them."""

import subprocess
import sys

from rows import for_each

_LEAN = "from bus.base import lean_asyncio; import sys\n"
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
        "import ssl, pickle; assert pickle.loads(pickle.dumps(ssl.SSLError)) is ssl.SSLError",
    ],
)
def test_late_modules_are_as_any_other(use: str) -> None:
    _run(f"{_LEAN}import asyncio\nassert asyncio.run\n{_NOT_LOADED}{use}\n")


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


def test_what_is_imported_already_stays() -> None:
    _run(f"import ssl, asyncio\nbefore = vars(ssl)['SSLContext']\n{_LEAN}assert ssl.SSLContext is before")


def test_a_python_without_tls_says_so_at_once() -> None:
    _run(
        "import sys; from importlib.machinery import PathFinder as P; find = P.find_spec\n"
        "P.find_spec = lambda name, *more: None if name in ('_ssl', 'ssl') else find(name, *more)\n"
        f"{_LEAN}import asyncio\nassert asyncio.base_events.ssl is None"
    )


def test_loading_that_fails_is_tried_again() -> None:
    _run(
        f"{_LEAN}import ssl\nsys.modules['_ssl'] = None\n"
        "try: ssl.SSLContext\nexcept ImportError: pass\nelse: raise SystemExit('no error')\n"
        "del sys.modules['_ssl']\nassert ssl.SSLContext"
    )
