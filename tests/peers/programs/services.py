"""Services over our own RTPS, alone: `python services.py DOMAIN HOST`. CDR is hexadecimal text."""

import asyncio
import sys
import threading
from collections.abc import Coroutine
from typing import Any

from orders import serve

from bus_bridge.dds.services import ServiceClient, Services
from bus_bridge.ros2.calls import RequestId
from bus_bridge.rtps.reach import Reach


class Peer:
    """A participant, on an event loop in a thread."""

    def __init__(self, domain: int, host: str) -> None:
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        self._clients: dict[str, ServiceClient] = {}
        self._warnings: list[str] = []
        self._services = self._run(self._open(domain, host))

    def _run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _open(self, domain: int, host: str) -> Services:
        return Services(domain, self._warnings.append, reach=Reach(host))

    def offer(self, service: str, type_name: str) -> None:
        """Make a server that answers with the request."""

        async def make() -> None:
            def on_request(request: RequestId, cdr: bytes) -> None:
                server.answer(request, cdr)

            server = self._services.serve(service, type_name, on_request)

        self._run(make())

    def ready(self, service: str, type_name: str) -> bool:
        """Whether a call of a service is possible."""

        async def look() -> bool:
            if service not in self._clients:
                self._clients[service] = self._services.make_client(service, type_name)
            return self._clients[service].is_ready

        return bool(self._run(look()))

    def call(self, service: str, request: str, count: int = 1, time_s: float = 20.0) -> list[str]:
        """Call a service, `count` times at once; the answers."""

        async def call() -> list[str]:
            calls = [self._clients[service].call(bytes.fromhex(request)) for _ in range(count)]
            answers = await asyncio.wait_for(asyncio.gather(*calls), time_s)
            return [one.cdr.hex() for one in answers]

        return list(self._run(call()))

    def warnings(self) -> list[str]:
        return self._warnings

    def close(self) -> None:
        async def end() -> None:
            self._services.close()

        self._run(end())


def main() -> None:
    peer = Peer(int(sys.argv[1]), sys.argv[2])
    serve({order: getattr(peer, order) for order in ("offer", "ready", "call", "warnings")})
    peer.close()


if __name__ == "__main__":
    main()
