"""The daemon of the bus: routes messages between the processes of one machine. See `bus` for the library."""
