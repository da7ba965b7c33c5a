"""A node as rmw_zenoh makes it, from its documents and sources: `python rmw_zenoh.py NAME ROUTER DOMAIN`.

It knows nothing of busd, and needs only zenoh and xxhash. CDR is hexadecimal text. Types are names as in keys
(`std_msgs::msg::dds_::String_`), with their hashes.
"""

import struct
import sys
import threading
import time
from functools import partial
from typing import Any

import xxhash
import zenoh
import zenoh.ext
from orders import serve, tell

_RELIABLE_VOLATILE_10 = "::,10:,:,:,,"


def gid_of(token: str) -> bytes:
    found = xxhash.xxh3_128_intdigest(token.encode())
    return struct.pack("<QQ", found & (2**64 - 1), found >> 64)


def read_attachment(data: Any) -> tuple[int, int, bytes]:
    number, time_ns, length, gid = struct.unpack("<qqB16s", data.to_bytes())
    assert length == 16
    return number, time_ns, gid


class Peer:
    """One session with one node."""

    def __init__(self, name: str, router: str, domain: int) -> None:
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
        self._id = str(self._session.zid())
        self._name, self._domain = name, domain
        self._last = 0
        self._held: dict[str, list[Any]] = {}
        self._publishers: dict[str, tuple[Any, bytes]] = {}
        self._numbers: dict[str, int] = {}
        self._clients: dict[str, tuple[str, bytes]] = {}
        self._seen: dict[str, str] = {}
        self._watch = self._session.liveliness().declare_subscriber(
            f"@ros2_lv/{domain}/**", self._see, history=True
        )
        self._node = self._session.liveliness().declare_token(self._token("0/NN"))

    def _see(self, sample: Any) -> None:
        key = str(sample.key_expr)
        if sample.kind == zenoh.SampleKind.PUT:
            self._seen[key] = gid_of(key).hex()
        else:
            self._seen.pop(key, None)

    def _token(self, middle: str) -> str:
        return f"@ros2_lv/{self._domain}/{self._id}/0/{middle}/%/%/{self._name}"

    def _announce(
        self, kind: str, name: str, type_name: str, type_hash: str, qos: str = _RELIABLE_VOLATILE_10
    ) -> bytes:
        self._last += 1
        mangled = name.replace("/", "%")
        key = self._token(f"{self._last}/{kind}") + f"/{mangled}/{type_name}/{type_hash}/{qos}"
        self._held.setdefault(name, []).append(self._session.liveliness().declare_token(key))
        return gid_of(key)

    def _key(self, name: str, type_name: str, type_hash: str) -> str:
        return f"{self._domain}/{name.strip('/')}/{type_name}/{type_hash}"

    def tokens(self) -> dict[str, str]:
        """All tokens in the domain, and their gids."""
        return dict(self._seen)

    def publish(self, topic: str, kept: int = 0, **kind: str) -> str:
        """Make a publisher, which keeps `kept` messages for late joiners; returns its gid."""
        if kept:
            publisher = zenoh.ext.declare_advanced_publisher(
                self._session,
                self._key(topic, **kind),
                cache=zenoh.ext.CacheConfig(kept),
                publisher_detection=True,
            )
            gid = self._announce("MP", topic, **kind, qos=f":1:,{kept}:,:,:,,")
        else:
            publisher = self._session.declare_publisher(self._key(topic, **kind))
            gid = self._announce("MP", topic, **kind)
        self._publishers[topic] = publisher, gid
        return gid.hex()

    def send(self, topic: str, messages: list[str], skip: int = 0, attachment: str | None = None) -> None:
        """Publish; `skip` numbers are left out before the first message, as if they were lost."""
        publisher, gid = self._publishers[topic]
        self._numbers[topic] = self._numbers.get(topic, 0) + skip
        for cdr in messages:
            number = self._numbers[topic] = self._numbers[topic] + 1
            head = struct.pack("<qqB", number, time.time_ns(), 16) + gid
            publisher.put(
                bytes.fromhex(cdr), attachment=head if attachment is None else bytes.fromhex(attachment)
            )

    def listen(self, topic: str, history: bool = False, **kind: str) -> None:
        """Make a subscription, which tells what it hears."""

        def hear(sample: Any) -> None:
            number, time_ns, gid = read_attachment(sample.attachment)
            message = {"cdr": sample.payload.to_bytes().hex(), "number": number, "gid": gid.hex()}
            message["priority"] = str(sample.priority)
            tell(heard=topic, message=message, source_time_ns=time_ns)

        if history:
            made: Any = zenoh.ext.declare_advanced_subscriber(
                self._session,
                self._key(topic, **kind),
                hear,
                history=zenoh.ext.HistoryConfig(detect_late_publishers=True),
            )
            self._announce("MS", topic, **kind, qos=":1:,10:,:,:,,")
        else:
            made = self._session.declare_subscriber(self._key(topic, **kind), hear)
            self._announce("MS", topic, **kind)
        self._held[topic].append(made)

    def offer(self, service: str, answer: str, pause_s: float = 0.0, **kind: str) -> None:
        """Make a server that tells each request, and always answers the same after `pause_s`."""
        key = self._key(service, **kind)

        def answer_it(query: Any, number: int, gid: bytes) -> None:
            head = struct.pack("<qqB", number, time.time_ns(), 16) + gid
            query.reply(key, bytes.fromhex(answer), attachment=head)
            query.drop()

        def ask(query: Any) -> None:
            number, _, gid = read_attachment(query.attachment)
            message = {"cdr": query.payload.to_bytes().hex(), "number": number, "gid": gid.hex()}
            tell(heard=service, message=message)
            if pause_s:
                threading.Timer(pause_s, partial(answer_it, query, number, gid)).start()
            else:
                answer_it(query, number, gid)

        made = self._session.declare_queryable(key, ask, complete=True)
        self._announce("SS", service, **kind)
        self._held[service].append(made)

    def call(
        self, service: str, request: str, count: int = 1, time_s: float = 10.0, **kind: str
    ) -> list[str | None]:
        """Call a service once it is there, `count` times at once; None without an answer in time."""
        if service not in self._clients:
            self._clients[service] = self._key(service, **kind), self._announce("SC", service, **kind)
        key, gid = self._clients[service]
        end = time.monotonic() + time_s
        wanted = "/SS/%busd%robot/"
        mangled = service.replace("/", "%")
        while not any(wanted in token and f"/{mangled}/" in token for token in self._seen):
            if time.monotonic() > end:
                return ["no server"]
            time.sleep(0.01)
        waiting = []
        for _ in range(count):
            number = self._numbers[service] = self._numbers.get(service, 0) + 1
            replies = self._session.get(
                key,
                payload=bytes.fromhex(request),
                attachment=struct.pack("<qqB", number, time.time_ns(), 16) + gid,
                target=zenoh.QueryTarget.ALL_COMPLETE,
                consolidation=zenoh.ConsolidationMode.NONE,
                timeout=max(end - time.monotonic(), 0.1),
            )
            waiting.append((number, replies))
        return [self._first_answer(number, gid, replies) for number, replies in waiting]

    def _first_answer(self, number: int, gid: bytes, replies: Any) -> str | None:
        for reply in replies:
            if reply.ok is not None and read_attachment(reply.ok.attachment)[::2] == (number, gid):
                return str(reply.ok.payload.to_bytes().hex())
        return None

    def crowd(self, count: int) -> None:
        """Announce many nodes, and tokens that are none."""
        declare = self._session.liveliness().declare_token
        space = f"@ros2_lv/{self._domain}"
        self._held["crowd"] = [
            declare(f"{space}/{one}") for one in ("x", f"{self._id}/0/0/NN/%/%/a b", "%/%")
        ]
        for number in range(10, 10 + count):
            self._held["crowd"].append(declare(f"{space}/{self._id}/{number}/{number}/NN/%/%/n{number}"))

    def end(self, name: str) -> None:
        """Withdraw all endpoints with this name."""
        for one in self._held.pop(name)[::-1]:
            one.undeclare()
        self._publishers.pop(name, None)
        self._clients.pop(name, None)

    def close(self) -> None:
        self._session.close()


def main() -> None:
    peer = Peer(sys.argv[1], sys.argv[2], int(sys.argv[3]))
    orders = ("tokens", "publish", "send", "listen", "offer", "call", "crowd", "end")
    serve({order: getattr(peer, order) for order in orders})
    peer.close()


if __name__ == "__main__":
    main()
