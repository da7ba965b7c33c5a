"""The protocol of the bus, sans-IO: bytes in, messages out, and back, for both ends. See docs/protocol.md."""
