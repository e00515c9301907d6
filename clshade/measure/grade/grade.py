"""`grade`: an image against the right one, and what is wrong with it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from ...base.arrays import Bools, Floats
from ...base.atomic_files import shown
from ...errors import InputError
from ...scene.model import Scene, Settings
from .drawing import Canvas, Drawing, as_codes, code_image, linear_image
from .mistakes.coverage import SUBPIXEL_SHIFTS
from .reading import read_codes
from .search import Explanation, applied, explain, wrong

_FEW = 0.05  # share of pixels, above which differences are no matter of edges


@dataclass(frozen=True, eq=False)
class Right:
    """The right image. drawing: what draws it. linear: (M, N, 3), row 0 at the top."""

    drawing: Drawing
    linear: Floats

    @property
    def name(self) -> str:
        return self.drawing.scene.name

    @property
    def codes(self) -> Floats:
        """The codes (M, N, 3) of its 8-bit file."""
        return np.rint(as_codes(self.linear))


@dataclass(frozen=True, eq=False)
class Grade:
    """What is found in an image.

    name: of its file. image: its codes (M, N, 3), 0 to 255. differ: number of pixels that differ by more than one code.
    edges: how many of these another rule for edges decides. worst: largest difference, codes. explanations: the best first,
    none if the image is right or nothing comes near. remarks: on its file, such as that it has alpha.
    """

    name: str
    image: Floats
    differ: int
    edges: int
    worst: float
    explanations: tuple[Explanation, ...]
    remarks: tuple[str, ...] = ()

    @property
    def right(self) -> bool:
        return self.differ == self.edges

    @property
    def best(self) -> Explanation | None:
        return self.explanations[0] if self.explanations else None

    def facts(self) -> dict[str, Any]:
        """Return the results as plain values: those of the best explanation among them, and of all."""
        explanations = [explanation.facts() for explanation in self.explanations]
        best = explanations[0] if explanations else {"mistake": ""}
        return {
            "image": self.name,
            "right": self.right,
            "pixels": self.image.shape[0] * self.image.shape[1],
            "pixels_that_differ": self.differ,
            "on_edges": self.edges,
            "largest_difference": self.worst / 255.0,
            "explained": bool(self.best and self.best.claimed),
            **best,
            "explanations": explanations,
            "remark": "; ".join(self.remarks),
        }


def right_of(scene: Scene, settings: Settings) -> Right:
    """Draw the right image. Raises InputError for settings that are not modeled."""
    if settings.samples != 1 or settings.shader == "pbr" or settings.shadows or settings.ambient_occlusion:
        raise InputError(
            "grade: settings: expected one sample, shader gouraud, phong or nolight, no shadows, found others"
        )
    if scene.camera.orthographic or any(mesh.blends or mesh.tests_alpha for mesh in scene.meshes):
        raise InputError(f"{scene.name}: expected opaque meshes seen in perspective, found others")
    drawing = Drawing(scene, settings)
    return Right(drawing, linear_image(drawing))


def explained_codes(right: Right, image: Floats, explanation: Explanation) -> Floats:
    """Return the codes (M, N, 3) of the image that the mistakes of an explanation give, on the background of `image`."""
    return np.rint(code_image(applied(_seen(right, image), explanation.changes)))


def grade(path: str | Path, right: Right) -> Grade:
    """Grade an image file. Raises InputError if it cannot be read or has another size than the right image."""
    codes, remarks = read_codes(path, (right.linear.shape[0], right.linear.shape[1]))
    return replace(graded(codes, right, shown(path)), remarks=remarks)


def graded(image: Floats, right: Right, name: str) -> Grade:
    """Grade an image, codes (M, N, 3)."""
    expected = right.codes if (image == np.rint(image)).all() else as_codes(right.linear)
    differ = wrong(image, expected)
    edges = _on_edges(image, right, differ)
    worst = float(np.abs(image - expected).max())
    explanations = [] if (differ == edges).all() else explain(_seen(right, image), image, right.linear, edges)
    return Grade(name, image, int(differ.sum()), int(edges.sum()), worst, tuple(explanations))


def _seen(right: Right, image: Floats) -> Drawing:
    """Return the right drawing with the color that the image has most often where the right one shows the background."""
    background = right.drawing.scene.background
    empty = (right.linear == (np.zeros(3) if background is None else background)).all(axis=2)
    if not empty.any():
        return right.drawing
    colors, counts = np.unique(image[empty], axis=0, return_counts=True)
    return replace(right.drawing, backdrop=colors[counts.argmax()] / 255.0)


def _on_edges(image: Floats, right: Right, differ: Bools) -> Bools:
    """Return (M, N) bool: which pixels that differ are right for an edge that is 1/256 px elsewhere: a fill rule, or how
    corners are rounded, decides these."""
    on_edge = np.zeros_like(differ)
    if not 0 < differ.sum() <= _FEW * differ.size:
        return on_edge
    rows, columns = np.nonzero(differ)
    canvas = Canvas(rows, columns)
    for moved in SUBPIXEL_SHIFTS.values():
        codes = np.rint(canvas.codes(moved(right.drawing)))
        on_edge[rows, columns] |= ~wrong(image[rows, columns], codes)
    return on_edge
