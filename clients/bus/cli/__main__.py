"""`python -m bus.cli`."""

from bus.cli.main import main

main()
