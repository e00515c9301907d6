"""`python -m clshade`."""

import sys

if __name__ == "__main__":
    try:
        from .cli import entry

        entry()
    except KeyboardInterrupt:  # while Python was still importing
        sys.exit(130)
