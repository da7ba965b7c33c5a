"""A bare client (`bare_client.py` and its subclasses in `tests/`) that is wrong in one way:

    python tests/wrong_clients.py WAY ROLE

WAYS has each way with the story that finds it, and a part of the text about it.
"""

import os
import signal
import socket
import sys
import time
from pathlib import Path
from typing import Any, NamedTuple

import msgspec

sys.path.insert(0, str(Path(__file__).parents[1] / "examples"))
from bare_client import FRAME, RECORD, RUN, Client, ConnectionLost, Endpoint
from lossless_client import Lossless, LosslessRelay
from service_clients import SUPPORT, Caller, Server


class NoHello(Client):
    def send(self, tag: str, **fields: Any) -> None:
        if tag == "hello":
            super().send("node+", request=1, name="early")
        else:
            super().send(tag, **fields)


class OtherVersion(Client):
    def send(self, tag: str, **fields: Any) -> None:
        super().send(tag, **fields | ({"version": 9} if tag == "hello" else {}))


class SameRequest(Client):
    def request(self, tag: str, endpoint: Endpoint | None, **fields: Any) -> None:
        self.requests = 0
        super().request(tag, endpoint, **fields)


class NoType(Client):
    def send(self, tag: str, **fields: Any) -> None:
        if tag != "type":
            super().send(tag, **fields)


class OtherHash(Client):
    def send(self, tag: str, **fields: Any) -> None:
        super().send(tag, **fields | ({"type_hash": "RIHS01_00"} if tag == "type" else {}))


class ShortGid(Client):
    def declare(self) -> None:
        for endpoint in self.endpoints:
            endpoint.gid = endpoint.gid[:4]
        super().declare()


class SameGid(Client):
    def declare(self) -> None:
        for endpoint in self.endpoints:
            endpoint.gid = b"0123456789abcdef"
        super().declare()


class GuessedNode(Client):
    def declare(self) -> None:
        self.node = 1
        super().declare()


class RelativeTopic(Client):
    def declare(self) -> None:
        self.endpoints[0].topic = "topic"
        super().declare()


class GuessedEndpoint(Client):
    def send_sample(self, endpoint: Endpoint, payload: bytes) -> None:
        endpoint.id = 2
        super().send_sample(endpoint, payload)


class WallClock(Client):
    def write(self, raw: bytes) -> None:
        if raw[4] == 2:
            size, _ = RECORD.unpack_from(raw, RUN.size)
            raw = raw[: RUN.size] + RECORD.pack(size, time.time_ns()) + raw[RUN.size + RECORD.size :]
        super().write(raw)


class Microseconds(Client):
    def write(self, raw: bytes) -> None:
        if raw[4] == 2:
            size, stamp_ns = RECORD.unpack_from(raw, RUN.size)
            raw = raw[: RUN.size] + RECORD.pack(size, stamp_ns // 1000) + raw[RUN.size + RECORD.size :]
        super().write(raw)


class OtherByteOrder(Client):
    def write(self, raw: bytes) -> None:
        if raw[4] == 2:
            raw = raw[: RUN.size] + raw[RUN.size : RUN.size + 4][::-1] + raw[RUN.size + 4 :]
        super().write(raw)


class OneRecordTooMany(Client):
    def write(self, raw: bytes) -> None:
        super().write(raw[:24] + b"\2" + raw[25:] if raw[4] == 2 else raw)


class BytesBehind(Client):
    def write(self, raw: bytes) -> None:
        length = int.from_bytes(raw[:4], "little") + 3
        super().write(length.to_bytes(4, "little") + raw[4:] + b"end" if raw[4] == 2 else raw)


class NoArray(Client):
    def send_sample(self, endpoint: Endpoint, payload: bytes) -> None:
        super().send_sample(endpoint, payload[1:])


class SameNumber(Client):
    def send_sample(self, endpoint: Endpoint, payload: bytes) -> None:
        endpoint.next_seq = 1
        super().send_sample(endpoint, payload)


class LongLength(Client):
    def write(self, raw: bytes) -> None:
        """The length counts its own bytes, too."""
        length, kind, flags, zero = FRAME.unpack_from(raw)
        super().write(FRAME.pack(length + 4, kind, flags, zero) + raw[FRAME.size :])


class FirstRecordOnly(Client):
    def take_run(self, frame: bytes) -> None:
        super().take_run(frame[:20] + (1).to_bytes(4, "little") + frame[24:])


class WrongPayload(Client):
    def take_sample(self, payload: bytes) -> None:
        super().take_sample(payload[:-1] + b"?")


class NoPing(Client):
    def send(self, tag: str, **fields: Any) -> None:
        if tag == "ping":
            self.sent_s = time.monotonic()
        else:
            super().send(tag, **fields)


class LengthOfAll(NoPing):
    def write(self, raw: bytes) -> None:
        super().write(len(raw).to_bytes(4, "little") + raw[4:])


class BlockingDoorbell(Client):
    def declare(self) -> None:
        body = msgspec.msgpack.encode({"m": "share"})
        frame = FRAME.pack(4 + len(body), 1, 0, 0) + body
        shared = [os.eventfd(0), os.memfd_create("readers")]
        socket.send_fds(self.socket, [frame], shared)
        for one in shared:
            os.close(one)
        super().declare()


class NoUnknownField(Client):
    def take_message(self, message: dict[Any, Any]) -> None:
        if "later" in message:
            raise ConnectionLost
        super().take_message(message)


class NoUnknownTag(Client):
    def take_message(self, message: dict[Any, Any]) -> None:
        if message["m"] == "later":
            os.abort()
        super().take_message(message)


class WholeFrames(Client):
    def frames(self) -> list[bytes]:
        """Each read is one frame."""
        raw, self.buffer = self.buffer, b""
        return [raw[4:]]


class NoPieces(Client):
    def frames(self) -> list[bytes]:
        """A read that is not exactly one frame is dropped."""
        raw, self.buffer = self.buffer, b""
        is_frame = len(raw) > 4 and int.from_bytes(raw[:4], "little") == len(raw) - 4
        return [raw[4:]] if is_frame else []


class SilentRefusal(Client):
    def take_message(self, message: dict[Any, Any]) -> None:
        if message["m"] != "refused":
            super().take_message(message)


class HappyRefusal(Client):
    def take_message(self, message: dict[Any, Any]) -> None:
        if message["m"] == "refused":
            print(message["text"])
            sys.exit(0)
        super().take_message(message)


class EventIsTheEnd(Client):
    def take_message(self, message: dict[Any, Any]) -> None:
        if message["m"] == "liveliness" and not message["alive"]:
            sys.exit("the publisher is not alive")
        super().take_message(message)


class FirstMatchOnly(Client):
    is_over = False

    def take_message(self, message: dict[Any, Any]) -> None:
        self.is_over = self.is_over or message["m"] == "unmatched"
        super().take_message(message)

    def talk(self) -> None:
        if not self.is_over:
            super().talk()


class OneNumberForAll(Client):
    def take_run(self, frame: bytes) -> None:
        """Takes the samples of a new publisher for repeated ones."""
        for endpoint in self.endpoints:
            highest = max(endpoint.last_seqs.values(), default=0)
            endpoint.last_seqs = dict.fromkeys(endpoint.gids.values(), highest)
        super().take_run(frame)


class NoCredit(Lossless):
    def take_credit(self, seq: int) -> None:
        pass


class NoWindow(Lossless):
    def talk(self) -> None:
        Client.talk(self)


class NoLimit(Client):
    def send_sample(self, endpoint: Endpoint, payload: bytes) -> None:
        endpoint.max_bytes = 1 << 30
        super().send_sample(endpoint, payload)


class SmallBuffer(Client):
    def frames(self) -> list[bytes]:
        """A frame that is longer than one read is dropped."""
        if len(self.buffer) > 65536:
            raise ConnectionLost
        return super().frames()


class NoReturn(Client):
    def run(self) -> None:
        try:
            super().run()
        finally:
            sys.exit("busd has gone")

    def read(self) -> None:
        try:
            super().read()
        except ConnectionLost:
            sys.exit("busd has gone")


class NewGids(Client):
    def declare(self) -> None:
        for endpoint in self.endpoints:
            endpoint.gid = os.urandom(16)
        super().declare()


class NumbersFromOne(Client):
    def declare(self) -> None:
        for endpoint in self.endpoints:
            endpoint.next_seq = 1
        super().declare()


class NoLastSeqs(Client):
    def declare(self) -> None:
        for endpoint in self.endpoints:
            endpoint.last_seqs.clear()
        super().declare()


class LateReplies(Server):
    first = "_request"


class OtherNumber(Server):
    def answer(self, client: bytes, number: int, body: Any) -> None:
        super().answer(client, 1, body)


class NoCallers(Server):
    def answer(self, client: bytes, number: int, body: Any) -> None:
        super().answer(b"0123456789abcdef", number, body)


class BareReply(Server):
    def answer(self, client: bytes, number: int, body: Any) -> None:
        """Without the error."""
        self.send_sample(self.replies_end, msgspec.msgpack.encode([client, number, [body.a + body.b]]))


class NoDenial(Server):
    def answer_question(self, client: bytes, number: int) -> None:
        pass


class AnswersQuestions(Server):
    def answer_question(self, client: bytes, number: int) -> None:
        """A question is a request with defaults."""
        self.answer(client, number, SUPPORT.request.cls())


class LateAnswers(Caller):
    first = "_request"


class OtherGid(Caller):
    def send_request(self, payload: bytes) -> None:
        super().send_request(payload.replace(self.requests_end.gid, b"0123456789abcdef"))


class AllReplies(Caller):
    def is_mine(self, client: bytes, number: int) -> bool:
        return self.waits and number == self.number


class NoQuestion(Caller):
    def ask(self) -> None:
        pass


class OneQuestion(Caller):
    asked = 0

    def ask(self) -> None:
        if self.asked != self.number:
            self.asked = self.number
            super().ask()


class OneCallNumber(Caller):
    def talk(self) -> None:
        if not self.waits:
            self.number = 0
        super().talk()


class AsksForEver(Caller):
    def take_sample(self, payload: bytes) -> None:
        if not self.is_unsure:
            super().take_sample(payload)


class FaultIsTheEnd(Client):
    def take_message(self, message: dict[Any, Any]) -> None:
        if message["m"] == "fault":
            sys.exit(f"busd: {message['text']}")
        super().take_message(message)


class LaterFaultIsTheEnd(FaultIsTheEnd):
    def take_message(self, message: dict[Any, Any]) -> None:
        if message.get("again"):
            raise ConnectionLost
        super().take_message(message)


class NoAck(LosslessRelay):
    def acknowledge(self, seq: int) -> None:
        pass


class Way(NamedTuple):
    client: type[Client]
    role: str
    story: str
    text: str
    beside_load: str = ""
    """Another text, if a whole frame may come in one read then."""

    def is_found_by(self, text: str) -> bool:
        return self.text in text or bool(self.beside_load and self.beside_load in text)


WAYS = [
    Way(NoHello, "talk", "hello", "a CreateNode came before Hello"),
    Way(OtherVersion, "talk", "hello", "protocol version 9 offered, this side speaks 1"),
    Way(SameRequest, "relay", "declare", "request 1 came twice"),
    Way(NoType, "talk", "declare", "comes without a DeclareType of std_msgs/msg/String with RIHS01_df66"),
    Way(OtherHash, "talk", "declare", "says RIHS01_00; its schema has RIHS01_df66"),
    Way(ShortGid, "listen", "declare", "has a gid of 4 bytes; it has 16"),
    Way(SameGid, "relay", "declare", "has the gid of subscription 42 on /conformance/in"),
    Way(GuessedNode, "talk", "declare", "names node 1; its nodes are 41"),
    Way(RelativeTopic, "talk", "declare", "must be absolute"),
    Way(GuessedEndpoint, "talk", "publish", "a data frame names 2; its publishers are 42"),
    Way(WallClock, "talk", "publish", "s in the future; stamps are CLOCK_MONOTONIC"),
    Way(Microseconds, "talk", "publish", "before the client's start; stamps are CLOCK_MONOTONIC in ns"),
    Way(OtherByteOrder, "talk", "publish", "record 1 of 1 in a data frame of publisher 42 on /topic claims"),
    Way(OneRecordTooMany, "talk", "publish", "publisher 42 on /topic has no record 2; its `count` is 2"),
    Way(BytesBehind, "talk", "publish", "publisher 42 on /topic has 3 bytes behind its 1 record"),
    Way(
        LengthOfAll, "talk", "hello", "its last frame is not complete: `length` counts the bytes after itself"
    ),
    Way(NoArray, "talk", "publish", "is no std_msgs/msg/String: Expected `array`, got `str`"),
    Way(SameNumber, "talk", "publish", "sent sample 1; its next number is at least 2"),
    Way(LongLength, "talk", "hello", "control message not understood"),
    Way(FirstRecordOnly, "relay", "subscribe", "returned fewer than the 3 samples of /conformance/in"),
    Way(WrongPayload, "relay", "subscribe", "sample 1 of /conformance/in (91 a9 6d"),
    Way(NoPing, "listen", "ping", "it was silent for"),
    Way(NoUnknownField, "listen", "unknown", "after a message with a field that it does not know"),
    Way(
        NoUnknownTag, "talk", "unknown", "after a message with an unknown tag the client was ended by SIGABRT"
    ),
    Way(WholeFrames, "talk", "split", "it closed the connection; the client ended with status 1"),
    Way(
        NoPieces,
        "talk",
        "split",
        "no CreateNode came after busd's Hello within",
        "no endpoint was created within",
    ),
    Way(SilentRefusal, "listen", "refusal", "it did not print the text of Refused"),
    Way(HappyRefusal, "talk", "refusal", "it ended with status 0, as if nothing was refused"),
    Way(FaultIsTheEnd, "talk", "fault", "after a Fault with `again`: the client ended with status 1"),
    Way(LaterFaultIsTheEnd, "relay", "fault", "after a Fault: the client ended with status 1"),
    Way(NoAck, "relay", "subscribe", "no Ack of sample 3 came for subscription 42 on /conformance/in"),
    Way(EventIsTheEnd, "listen", "events", "the client ended with status 1"),
    Way(FirstMatchOnly, "talk", "events", "did not send sample"),
    Way(
        OneNumberForAll,
        "relay",
        "events",
        "returned fewer than the 4 samples of /conformance/in, of which 2 are of a second publisher with "
        "numbers from 1: 2 within",
    ),
    Way(NoWindow, "talk", "window", "sent sample 4; its credit is 0, and window_samples of Created is 3"),
    Way(NoCredit, "talk", "window", "did not send sample 6 after Credit for 3; its last one was 3"),
    Way(NoLimit, "relay", "limit", "has 203 bytes; max_message_bytes of Created is 200"),
    Way(SmallBuffer, "relay", "growth", "sample 3, of 100006 bytes, did not come back by socket and socket"),
    Way(NoReturn, "talk", "restart", "the client ended with status 1"),
    Way(NewGids, "talk", "restart", "did not come back with its gid"),
    Way(NumbersFromOne, "talk", "restart", "next_seq is 1, and it is at least 2 after its sample 1"),
    Way(
        NoReturn, "talk", "real", "it did not come back after a kill of busd; the client ended with status 1"
    ),
    Way(BlockingDoorbell, "talk", "real", "Share with a bad descriptor: eventfd would block"),
    Way(WrongPayload, "relay", "real", "sample 1 (91 a9 6d 65"),
    Way(NoLastSeqs, "listen", "restart", "came back with nothing in last_seqs"),
    Way(LateReplies, "serve", "serve", "created its publisher of replies last"),
    Way(OtherNumber, "serve", "serve", "/add replied to call 1 of 636f6e66"),
    Way(NoCallers, "serve", "serve", "/add replied to call 1099511627776 of 3031323334"),
    Way(BareReply, "serve", "serve", "is no example_interfaces/srv/AddTwoInts_Response"),
    Way(NoDenial, "serve", "serve", "did not reply to a question about call"),
    Way(AnswersQuestions, "serve", "serve", "error '' and body 91 00; both must be empty"),
    Way(LateAnswers, "call", "call", "created its subscription to replies last"),
    Way(OtherGid, "call", "call", "is of the client 303132333435"),
    Way(AllReplies, "call", "call", "it did not ask about call 1 of /add after it had lost the connection"),
    Way(NoQuestion, "call", "call", "it did not ask about call 1 of /add after it had lost the connection"),
    Way(OneQuestion, "call", "call", "it did not ask again about call 1 of /add"),
    Way(OneCallNumber, "call", "call", "it used the number 1 for another call of /add"),
    Way(AsksForEver, "call", "call", "it asked once more about call 1 of /add, which has ended"),
]


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    name, role = sys.argv[1:]
    next(way.client for way in WAYS if way.client.__name__ == name)(role).run()
