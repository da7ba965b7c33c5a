"""The targets by name."""

from collections.abc import Callable

from bus.shm import why_not
from fuzz import (
    bridge_targets,
    broker_targets,
    cdr_targets,
    client_targets,
    discovery_targets,
    hostile_ring,
    native_targets,
    rmw_zenoh_targets,
    rtps_targets,
    text_targets,
    wire_targets,
)

Target = Callable[[bytes], None]
"""Raises nothing for any bytes."""

TARGETS: dict[str, Target] = {
    "frames": wire_targets.frames,
    "session": wire_targets.session,
    "runs": wire_targets.runs,
    "receiver": wire_targets.receiver,
    "outbox": wire_targets.outbox,
    "control": broker_targets.control,
    "broker": broker_targets.broker,
    "client": client_targets.client,
    "reader": hostile_ring.reader,
    "packs": native_targets.packs,
    "plans": native_targets.plans,
    "parts": bridge_targets.parts,
    "tokens": bridge_targets.tokens,
    "ros_tokens": rmw_zenoh_targets.ros_tokens,
    "datagrams": rtps_targets.datagrams,
    "announcements": rtps_targets.announcements,
    "participant": rtps_targets.participant,
    "discovery_servers": discovery_targets.discovery_servers,
    "configuration": text_targets.configuration,
    "parameters": text_targets.parameters,
    "arguments": text_targets.arguments,
    "names": text_targets.topic_names,
    "definitions": text_targets.definitions,
    "documents": text_targets.documents,
    "expressions": text_targets.expressions,
    "schemas": text_targets.schemas,
    "cdr": cdr_targets.cdr,
    "wheels": cdr_targets.wheels,
    "payloads": cdr_targets.payloads,
    "bag_definitions": cdr_targets.bag_definitions,
}
NATIVE = ("ring", "gates", "records", "c_client")
"""The targets in C, in tests/native; `make native` runs their kept inputs."""

OF_THE_CORE = ("reader", "packs", "plans")

if why_not():
    for _name in OF_THE_CORE:
        del TARGETS[_name]
