"""`python -m clshade`, and the console script."""

from __future__ import annotations

import gc
import os
import sys

try:
    from .base import interrupts
except KeyboardInterrupt:
    print("clshade: interrupted", file=sys.stderr)
    sys.exit(130)


def _command() -> int:
    # NumPy's BLAS threads would busy-wait beside the kernels, and nothing here multiplies large matrices.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    gc.set_threshold(20_000)  # imports make many objects, and hardly any garbage
    from .cli.main import main

    return main()


def entry() -> None:
    interrupts.run(_command)


if __name__ == "__main__":
    entry()
