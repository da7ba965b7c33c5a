"""Entry point of `python -m bus_cli`."""

from bus_cli.entry import main

main()
