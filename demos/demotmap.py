"""Figures 17 to 19 of the course: the object with a texture map, gouraud, phong and without light.

Each as EXR (linear) and PNG (clamped), and all on the sheet demotmap.png.

    python demos/demotmap.py [--scene h3.npy --texture cat_diff.png] [--out DIR]
"""

from __future__ import annotations

import sys
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

from clshade.course import figures  # noqa: E402
from clshade.course.figures import Figure  # noqa: E402


def plan() -> tuple[list[Figure], list[tuple[Figure, Figure]]]:
    """Return the figures, and the pair (gouraud, phong) whose difference is shown."""
    drawn = [Figure(17 + k, shader, "map", mapped=True) for k, shader in enumerate(("gouraud", "phong", "nolight"))]
    return drawn, [(drawn[0], drawn[1])]


if __name__ == "__main__":
    sys.exit(figures.main(str(__doc__).splitlines()[0], plan, "demotmap.png"))
