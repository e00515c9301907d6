"""Figures 1 to 16 of the course: gouraud and phong shading, by kind of light and by light.

1-4 gouraud: ambient, diffuse, specular light, all three; 5-8 gouraud: the first, second, third light, all of them;
9-16 the same with phong. Each as EXR (linear) and PNG (clamped), and all on the sheet demo.png.

    python demos/demo.py [--scene h3.npy] [--out DIR]
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
    """Return the figures, and the pairs (gouraud, phong) whose difference is shown."""
    drawn: list[Figure] = []
    for shader in ("gouraud", "phong"):
        first = len(drawn) + 1
        for k, term in enumerate(("ambient", "diffuse", "specular")):
            drawn.append(Figure(first + k, shader, f"{term} only", (term,)))
        drawn.append(Figure(first + 3, shader, "all terms"))
        for k in range(3):
            drawn.append(Figure(first + 4 + k, shader, f"light {k + 1} only", lights=(k,)))
        drawn.append(Figure(first + 7, shader, "all lights"))
    return drawn, [(drawn[k], drawn[k + 8]) for k in range(4)]


if __name__ == "__main__":
    sys.exit(figures.main(str(__doc__).splitlines()[0], plan, "demo.png"))
