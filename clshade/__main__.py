"""`python -m clshade`."""

import sys

if __name__ == "__main__":
    try:
        from .cli import entry

        entry()
    except KeyboardInterrupt:  # while Python was still importing
        print("clshade: interrupted", file=sys.stderr)
        sys.exit(130)
