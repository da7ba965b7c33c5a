"""The layout of a frame's bytes.

Owns offsets, sizes and numbers of the wire. Everything is little-endian.

    frame     0        4      5      6       8
              | length | kind | flags| zero  | rest of the frame ...
                u32      u8     u8     u16     (length counts the bytes after itself)

    control   8
              | one control message, MessagePack ...

    data      8          12       16          24      28      32
              | endpoint | source | first_seq | count | zero  | `count` records ...
                u32        u32      u64         u32     u32

    record    0              4           12
              | payload size | stamp ns  | payload ...
                u32            i64

A data frame carries a *run*: samples of one publisher with consecutive sequence numbers. `endpoint` is the
publisher on the way to the broker and the subscription on the way from it. `source` is the publisher. On the
way to the broker its place has `only_for`: the only subscription for the run, or 0 for all. Stamps are
CLOCK_MONOTONIC, which all processes of a machine share.
"""

import struct
from typing import Final

PROTOCOL_VERSION: Final = 1

LEAVING: Final = "leaving"
"""Capability, in the Hello of a client that understands the message Leaving."""

NAMESAKES: Final = "namesakes"
"""Capability, in the Hello of a client that understands the message Namesake."""

SILENCE: Final = "silence"
"""Capability, in the Hello of a client that understands the message Silence."""

PLACES: Final = "places"
"""Capability, in the Hello of a client with reliable keep-all publishers that keep the place of a lost
subscription, and resend the messages that it missed."""

BRIDGES: Final = "bridges"
"""Capability, in the Hello of a busd that knows origins, mirrors and taps."""

ACCESS: Final = "ACCESS"
"""In place of a policy, in Incompatible: the other end was denied access."""

CONTROL: Final = 1
DATA: Final = 2

REPLAY: Final = 1
"""Flag of a data frame: its samples were published before the subscription was made (transient local)."""

RESUMED: Final = 2
"""Flag of a data frame: samples with the missing numbers before it used another route, and are not lost."""

FRAME_HEAD: Final = struct.Struct("<IBBH")
DATA_HEAD: Final = struct.Struct("<IBBHIIQII")
RECORD_HEAD: Final = struct.Struct("<Iq")

LENGTH_BYTES: Final = 4
FRAME_HEAD_BYTES: Final = FRAME_HEAD.size
DATA_HEAD_BYTES: Final = DATA_HEAD.size
RECORD_HEAD_BYTES: Final = RECORD_HEAD.size

MAX_CONTROL_BYTES: Final = 1 << 20
"""Longest control message towards the broker. A broker's snapshots are longer."""

MAX_SNAPSHOT_BYTES: Final = 256 << 20
"""Longest control message that a client accepts from its broker."""

MAX_MESSAGE_BYTES: Final = 1 << 30
"""The highest limit for encoded messages that a configuration may set."""

RUN_BYTES: Final = 64 << 10
"""A publisher ends a run that has reached this size. So a body is shorter than this plus one record."""

MAX_RUN_SAMPLES: Final = RUN_BYTES // RECORD_HEAD_BYTES + 1
"""Most samples that a run can hold."""

MAX_COUNT: Final = (1 << 62) - 1
"""Largest sequence number and counter. The sum of any two fits into 64 bits."""
