"""The socket and those who connect to it: let in, served in turns, sent off."""
