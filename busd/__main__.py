"""`python -m busd`."""

import sys

from busd.entry import main

if __name__ == "__main__":
    sys.exit(main())
