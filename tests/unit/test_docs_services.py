"""The worked bytes of docs/services.md: computed here by its words alone, and equal to busd's own."""

import hashlib
import json
import re
from pathlib import Path
from typing import Any

import msgspec

from bus.srv.example_interfaces import AddTwoInts
from bus.types.service import service_support

PAGE = (Path(__file__).parents[2] / "docs" / "services.md").read_text()
SECTION = PAGE.partition("## On the bus\n")[2]
BLOCKS = re.findall(r"^```(\w*)\n(.*?)\n```$", SECTION, re.MULTILINE | re.DOTALL)
TEXTS = [text for language, text in BLOCKS if language == "json"]
PAYLOADS = [bytes.fromhex(text) for _, text in BLOCKS if re.fullmatch(r"[0-9a-f]{2}( [0-9a-f]{2})+", text)]
HASHES = [text for _, text in BLOCKS if re.match(r"[A-Z]+01_", text)]
DIGEST = next(text for _, text in BLOCKS if re.fullmatch(r"[0-9a-f]{16}", text))

CLIENT = bytes(range(16))
SUPPORT = service_support(AddTwoInts)


def sha(text: str) -> str:
    return hashlib.sha256(text.encode()).hexdigest()


def described(name: str, *fields: tuple[str, dict[str, Any]], needs: tuple[dict[str, Any], ...] = ()) -> str:
    """The JSON text that ROS 2 hashes."""
    root = {"type_name": name, "fields": [{"name": field, "type": type_} for field, type_ in fields]}
    return json.dumps({"type_description": root, "referenced_type_descriptions": [*needs]})


def field_type(number: int, capacity: int = 0, nested: str = "") -> dict[str, Any]:
    return {"type_id": number, "capacity": capacity, "string_capacity": 0, "nested_type_name": nested}


INT64, UINT64, BYTES_16 = field_type(8), field_type(9), field_type(48 + 3, 16)


def test_the_payloads() -> None:
    request, reply, failed, question, denial = PAYLOADS
    assert request == SUPPORT.encode_request(CLIENT, 1, AddTwoInts.Request(a=40, b=2))
    assert reply == SUPPORT.encode_response(CLIENT, 1, AddTwoInts.Response(sum=42))
    assert failed == SUPPORT.encode_error(CLIENT, 1, "no")
    assert question == SUPPORT.encode_question(CLIENT, 1)
    assert denial == SUPPORT.encode_denial(CLIENT, 1)
    assert msgspec.msgpack.decode(request) == [CLIENT, 1, [40, 2]]
    assert msgspec.msgpack.decode(reply) == [CLIENT, 1, "", [42]]


def test_the_hashes_of_the_bodies_and_their_digest() -> None:
    request, response, *_ = HASHES
    text = TEXTS[0].replace("\n", " ")
    assert text == described("example_interfaces/srv/AddTwoInts_Request", ("a", INT64), ("b", INT64))
    assert request == "RIHS01_" + sha(text)
    assert response == "RIHS01_" + sha(
        described("example_interfaces/srv/AddTwoInts_Response", ("sum", INT64))
    )
    assert sha(f"{request} {response}")[:16] == DIGEST


def test_the_hash_of_the_requests_is_ros_2s() -> None:
    name = "example_interfaces/srv/AddTwoInts_Request"
    inner = {
        "type_name": f"{name}_{DIGEST}",
        "fields": [{"name": field, "type": INT64} for field in "ab"],
    }
    body = field_type(1, nested=f"{name}_{DIGEST}")
    text = described(name, ("client", BYTES_16), ("number", UINT64), ("body", body), needs=(inner,))
    assert TEXTS[2].replace("\n", " ") == text
    assert HASHES[2] == f"RIHS01_{sha(text)}" == SUPPORT.requests.hash
    declared = msgspec.msgpack.decode(SUPPORT.requests.description)
    assert all(field.pop("required") is True for field in declared["types"][name]["fields"])
    assert declared["types"] == {
        name: {
            "array": True,
            "fields": [
                {"name": "client", "type": ["bytes", 16, 16]},
                {"name": "number", "type": "uint64"},
                {"name": "body", "type": f"{name}_{DIGEST}"},
            ],
        },
        f"{name}_{DIGEST}": {"array": True, "fields": [{"name": field, "type": "int64"} for field in "ab"]},
    }


def test_the_hash_of_the_responses_is_of_the_schema() -> None:
    text = TEXTS[1].replace("\n", "")
    assert json.dumps(json.loads(text), sort_keys=True, separators=(",", ":")) == text
    support = SUPPORT.replies(CLIENT)
    assert HASHES[3] == f"BUS01_{sha(text)}" == support.hash
    declared = msgspec.msgpack.decode(support.description)
    envelope = declared["types"]["example_interfaces/srv/AddTwoInts_Response"]["fields"]
    assert all(field.pop("required") is True for field in envelope)
    assert declared == json.loads(text), "DeclareType carries the same schema"
