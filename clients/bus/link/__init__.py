"""The connection of an event loop to busd, and what is told over it."""
