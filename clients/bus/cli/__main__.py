"""`python -m bus.cli`."""

import sys

from bus.cli.main import main

sys.exit(main())
