"""The protocol of the bus, sans-IO: bytes in, messages out, and back. Both ends use it; see docs/protocol.md."""
