"""The connection of an event loop to busd, and what goes over it."""
