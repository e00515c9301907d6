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

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

from clshade.course import demo, figures  # noqa: E402

if __name__ == "__main__":
    interrupts.run(lambda: demo.main(str(__doc__).splitlines()[0], figures.lit(), "demo.png"))
