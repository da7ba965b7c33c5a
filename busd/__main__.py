"""`python -m busd`."""

import sys

from busd.run import main

if __name__ == "__main__":
    sys.exit(main())
