"""The engine for zenoh, between buses on different machines; with the extra `zenoh`."""
