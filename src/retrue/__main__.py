"""`python -m retrue` is `retrue`."""

import sys

from retrue.cli.main import main

if __name__ == "__main__":
    sys.exit(main())
