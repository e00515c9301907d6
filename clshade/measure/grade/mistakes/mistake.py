"""A mistake: a sentence for the student, and what it does to the drawing of the right image."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

from ....scene.model import Material, with_materials
from ..drawing import Drawing, Edit

Edits = Mapping[str, Edit]  # of the variants of a mistake by their words, "" where there is one only


class Mistake(NamedTuple):
    """A mistake, in one or more variants.

    name: short. advice: what is wrong and what to do. edits: of its variants, or what returns those that the right drawing
    can have. when: whether that can have any. early: whether it precedes those that concern the finished image. moves:
    whether it exchanges pixels.
    """

    name: str
    advice: str
    edits: Edits | Callable[[Drawing], Edits]
    when: Callable[[Drawing], bool] = lambda drawing: True
    early: bool = True
    moves: bool = False

    def variants(self, drawing: Drawing) -> Edits:
        """Return the edits of the variants that the right drawing can have."""
        if not self.when(drawing):
            return {}
        return self.edits(drawing) if callable(self.edits) else self.edits


def setting(name: str, value: Any) -> Edit:
    return lambda drawing: replace(drawing, settings=replace(drawing.settings, **{name: value}))


def wrong_setting(name: str, wrong: Mapping[Any, Any]) -> Callable[[Drawing], Edits]:
    """Return the variant of a mistake that takes a value of a setting for another. wrong: by the right value."""

    def edits(drawing: Drawing) -> Edits:
        right = getattr(drawing.settings, name)
        words = wrong[right] if len(wrong) > 1 and right in wrong else ""
        return {words: setting(name, wrong[right])} if right in wrong else {}

    return edits


def of_materials(drawing: Drawing, change: Callable[[Material], Material]) -> Drawing:
    """Return the drawing with changed materials."""
    return replace(drawing, scene=with_materials(drawing.scene, change))


def scaled(drawing: Drawing, **factors: float) -> Drawing:
    """Return the drawing with coefficients of all materials multiplied."""

    def change(material: Material) -> Material:
        return replace(material, **{name: getattr(material, name) * factor for name, factor in factors.items()})

    return of_materials(drawing, change)


def plain_materials(drawing: Drawing) -> Drawing:
    """Return the drawing with materials whose color is that of the vertices."""
    return of_materials(drawing, lambda material: replace(material, texture=None, color=1.0))
