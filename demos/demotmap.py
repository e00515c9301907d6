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

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

from clshade.course import demo, figures  # noqa: E402

if __name__ == "__main__":
    interrupts.run(lambda: demo.main(str(__doc__).splitlines()[0], figures.mapped(), "demotmap.png"))
