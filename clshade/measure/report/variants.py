"""The variants of a scene that `report` compares, and the settings that they change."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

from ...base.spelling import hint
from ...errors import InputError
from ...pipeline.effective_settings import picture_fields
from ...pipeline.features import texture_applies
from ...pipeline.opencl.device import Device
from ...scene.model import Scene, Settings

BASE = "standard"


@dataclass(frozen=True, eq=False)
class Variant:
    """One way of drawing. name: for `--only` and programs. title: for people. changes: fields of Settings, relative to the
    preset `standard` or the given base settings."""

    name: str
    title: str
    changes: dict[str, Any]

    def settings(self, base: Settings) -> Settings:
        return replace(base, **self.changes)

    def changed(self) -> str:
        return " ".join(f"{name}={value}" for name, value in self.changes.items())


def _variant(name: str, title: str, **changes: Any) -> Variant:
    return Variant(name, title, changes)


TEXTURES = ("texture_at", "texture_filter")  # fields without effect if there is no texture
LIGHT_POINTS = (1, 4, 64)  # besides 16
OCCLUSION_RAYS = (1, 4, 16, 64)  # besides the base's own
COURSE = {"visibility": "painter", "lighting_at": "centroid", "interpolation": "affine", "texture_at": "vertex"}
VARIANTS = (
    _variant(BASE, "1 sample"),
    _variant("float64", "precision float64", precision="float64"),
    *(_variant(f"samples-{n}", f"{n} samples", samples=n) for n in (4, 16, 64)),
    *(_variant(f"shaded-{n}", f"{n} shaded samples", samples=n, sample_shading=True) for n in (4, 16, 64)),
    _variant("weighted-16", "16 weighted samples", samples=16, resolve="weighted"),
    _variant("gouraud", "Gouraud", shader="gouraud"),
    *(_variant(f"gouraud-{n}", f"{n} Gouraud samples", samples=n, shader="gouraud") for n in (4, 16)),
    _variant("centroid", "light at the centroid", lighting_at="centroid"),
    _variant("vertex-texture", "textures at corners", texture_at="vertex"),
    _variant("trilinear", "mip maps", texture_filter="trilinear"),
    *(_variant(f"trilinear-{n}", f"{n} mip-mapped samples", samples=n, texture_filter="trilinear") for n in (4, 16)),
    *(_variant(f"light-{n}", f"16 samples, light points: {n}", samples=16, light_samples=n) for n in LIGHT_POINTS),
    *(
        _variant(f"occlusion-{n}", f"16 samples, occlusion rays: {n}", samples=16, ambient_occlusion=n)
        for n in OCCLUSION_RAYS
    ),
    _variant("painter", "painter's order", visibility="painter"),
    _variant("affine", "affine interpolation", interpolation="affine"),
    _variant("course", "preset course", **COURSE),
    _variant("course-16", "16 samples of preset course", samples=16, **COURSE),
)


# The variants of a report without details: those that are worth their time on some scene, and others for a limit.
COMMON = (
    *(BASE, "samples-4", "samples-16", "samples-64", "shaded-4", "shaded-16", "shaded-64"),
    *("gouraud", "gouraud-4", "trilinear-4", "light-1", "light-4", "light-64", "occlusion-4", "occlusion-64"),
)
LIMITED = ("gouraud-16", "trilinear", "vertex-texture", "course")


def base_settings(scene: Scene, **given: Any) -> Settings:
    """Return the preset `standard` with the ambient term, model of reflection, shadows and ambient occlusion of the scene's
    pictures, which approximate no other. given: fields in place of these."""
    usual = picture_settings(scene, **given)
    fields = {name: getattr(usual, name) for name in ("ambient", "shader", "shadows", "ambient_occlusion")}
    return Settings.from_preset("standard", **{**fields, **given})


def picture_settings(scene: Scene, **given: Any) -> Settings:
    """Return the settings that `render` draws the scene with. given: fields that were given to it."""
    return Settings.from_preset(scene.preset, **picture_fields(scene, **given))


def possible(changes: dict[str, Any], base: Settings, device: Device) -> bool:
    """Return whether the changes are valid for the base, and the device can draw the result."""
    if base.shader == "pbr" and "shader" in changes:  # no approximation, but another picture
        return False
    if changes.get("precision") == "float64" and not device.has_fp64:
        return False
    try:
        replace(base, **changes)
    except InputError:
        return False
    return True


def variants_for(scene: Scene, base: Settings, device: Device) -> list[Variant]:
    """Return the variants that the device can draw and that differ on this scene; of equal ones the first.

    base: settings that they change.
    """
    variants: dict[Settings, Variant] = {}
    for variant in VARIANTS:
        if possible(variant.changes, base, device):
            variants.setdefault(_effective(variant, scene, base), variant)
    return list(variants.values())


def _effective(variant: Variant, scene: Scene, base: Settings) -> Settings:
    """Return the settings of a variant without changes that make no difference to the scene."""
    without = {
        *(() if any(texture_applies(mesh) for mesh in scene.meshes) else TEXTURES),
        *(() if any(light.has_size for light in scene.lights) else ("light_samples",)),
        *(() if base.ambient_occlusion else ("ambient_occlusion",)),
    }
    return replace(base, **{name: value for name, value in variant.changes.items() if name not in without})


def default_variant(scene: Scene, base: Settings, variants: Sequence[Variant], **given: Any) -> Variant:
    """Return the variant that `render` draws: one of these, or else a new one. given: as of `base_settings`."""
    usual = vars(picture_settings(scene, **given))
    changes = {name: value for name, value in usual.items() if value != getattr(base, name)}
    found = Variant("default", "default of render", changes)
    settings = _effective(found, scene, base)
    return next((variant for variant in variants if _effective(variant, scene, base) == settings), found)


def named(variants: Sequence[Variant], names: Sequence[str]) -> list[Variant]:
    """Return the named variants, or all without names.

    Raises InputError for an unknown name, and for one not among `variants`, those for a scene and a device.
    """
    by_name = {variant.name: variant for variant in variants}
    for name in names:
        if name not in by_name:
            why = next(
                (f", which {_left_out(variant)}" for variant in VARIANTS if variant.name == name), hint(name, by_name)
            )
            raise InputError(f"report: --only: expected names of {', '.join(by_name)}, found {name!r}{why}")
    return [by_name[name] for name in dict.fromkeys(names)] if names else list(variants)


def _left_out(variant: Variant) -> str:
    """Return why `variants_for` leaves it out."""
    if variant.changes.get("precision") == "float64":
        return "needs a device with float64"
    if "shader" in variant.changes:
        return "is another picture than shader pbr's"
    return "changes nothing of this scene"
