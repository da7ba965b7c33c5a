"""The broker as a pure state machine: values in, effects out. No I/O, no clock, no event loop."""
