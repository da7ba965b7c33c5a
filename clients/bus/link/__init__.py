"""The connection of an event loop to busd, and its traffic."""
