"""`python -m bus.cli`."""

from bus.cli.entry import main

main()
