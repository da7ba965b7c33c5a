"""A node of pyzeros, which speaks rmw_zenoh's protocol: `python zeros.py NAME ROUTER DOMAIN`.

It publishes numbers on /theirs, hears /ours, serves /theirs_set, and calls /ours_set when told so. Without
arguments it only compiles the codecs of its types, which pyzeros does at their first use, in half a minute.
"""

import asyncio
import sys
import threading
from collections.abc import Coroutine
from typing import Any

import pyzeros
import zenoh
from orders import serve, tell
from pyzeros.builtin_msgs import Attachment
from ros2_pyterfaces.cydr.all_msgs import String
from ros2_pyterfaces.cydr.all_srvs import SetBool


class Peer:
    """One node, on an event loop in a thread."""

    def __init__(self, name: str, router: str, domain: int) -> None:
        self._loop = asyncio.new_event_loop()
        threading.Thread(target=self._loop.run_forever, daemon=True).start()
        config = zenoh.Config()
        for key, value in {
            "mode": '"peer"',
            "connect/endpoints": f'["{router}"]',
            "listen/endpoints": '["tcp/localhost:0"]',
            "scouting/multicast/enabled": "false",
            "timestamping/enabled": "true",
        }.items():
            config.insert_json5(key, value)
        self._session = zenoh.open(config)
        self._client: Any = None
        self._tasks: list[asyncio.Task[None]] = []
        self._run(self._open(name, domain))

    def _run(self, work: Coroutine[Any, Any, Any]) -> Any:
        return asyncio.run_coroutine_threadsafe(work, self._loop).result()

    async def _open(self, name: str, domain: int) -> None:
        context = pyzeros.auto_context(node=name, zenoh_session=self._session, domain_id=domain)
        context.__enter__()
        self._publisher = pyzeros.Pub(String, "/theirs")
        self._tasks += [
            asyncio.create_task(self._hear(pyzeros.Sub(String, "/ours"))),
            asyncio.create_task(self._answer(pyzeros.Server(SetBool, "/theirs_set"))),
        ]
        self._client = pyzeros.Client(SetBool, "/ours_set")

    async def _hear(self, subscription: Any) -> None:
        async for message in subscription.listen_reliable(queue_size=1000):
            tell(heard="/ours", message=message.data.decode())

    async def _answer(self, server: Any) -> None:
        async for one in server.listen_reliable():
            one.response.success = one.request.data
            one.response.message = b"theirs"
            one.send()

    def send(self, count: int) -> None:
        """Publish numbers."""

        async def publish() -> None:
            for number in range(count):
                self._publisher.publish(String(data=str(number).encode()))

        self._run(publish())

    def call(self, data: bool) -> list[Any]:
        """Call /ours_set."""

        async def call() -> list[Any]:
            await self._client.wait_for_service()
            answer = await self._client.call_async(SetBool.Request(data=data))
            return [bool(answer.success), answer.message.decode()]

        return list(self._run(call()))

    def close(self) -> None:
        self._session.close()


def compile_codecs() -> None:
    for one in (String, SetBool.Request, SetBool.Response, Attachment):
        one().serialize()


def main() -> None:
    if len(sys.argv) == 1:
        compile_codecs()
        return
    peer = Peer(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    serve({"send": peer.send, "call": peer.call})
    peer.close()


if __name__ == "__main__":
    main()
