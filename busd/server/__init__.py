"""The socket and its connections: let in, served in turns, sent off."""
