"""Kinds of random scenes. Building a kernel program takes seconds, so all that determines the program is a `Kind`, which the
scenes of a block share; everything else differs from scene to scene."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from clshade.base.declare import facts_of
from clshade.scene.settings import PRESET_FIELDS, Edges, Preset, Settings

BLOCK = 50  # consecutive scenes of one kind
LANES = (1, 4, 8, 16)  # pixels per vector; the last is a CPU's default
KINDS = 80  # number of kinds; then they repeat
Random = np.random.Generator


@dataclass(frozen=True)
class Kind:
    """All that determines the kernel program.

    specialize: whether the program leaves out unneeded features. Only then the flags below apply: if one is set, the
    first mesh or light of the kind's scenes has the feature; otherwise none has. Otherwise all optional features are
    compiled in, and scenes have them or not. lanes: pixels per vector on a CPU; None: the device's default.
    other_lanes: for scenes that are drawn twice to compare the bits. double: whether positions may need float64.
    bright: whether colors exceed 1. scalars: whether a color map shows scalars of one more mesh, of its "vertices" or
    of its faces' "corners". around, backdrop: whether an environment lights the scene, or is the background. shaped,
    sized: whether lights have directions, cones or attenuation, or sizes.
    """

    settings: Settings
    preset: Preset
    specialize: bool
    lanes: int | None
    other_lanes: int
    orthographic: bool
    background: bool
    double: bool
    several: bool
    front: bool
    two_sided: bool
    colored: bool
    bright: bool
    textured: bool
    nearest: bool
    uv_faces: bool
    normal_faces: bool
    alpha: bool
    transparent: bool
    ambient: bool
    diffuse: bool
    specular: bool
    power: bool
    maps: bool
    facets: bool
    around: bool
    backdrop: bool
    shaped: bool
    sized: bool
    scalars: str

    @property
    def dim(self) -> bool:
        """Whether no color may exceed 1."""
        return self.settings.shader in ("phong", "pbr") and not self.bright


def kind_of(seed: int, block: int) -> Kind:
    """Return the kind of a block of scenes."""
    rng = np.random.default_rng([seed, block % KINDS, 0])

    def often(share: float) -> bool:
        return bool(rng.random() < share)

    shader = str(rng.choice(("phong", "gouraud", "nolight", "pbr")))
    lit, textured, specialize = shader != "nolight", often(0.6), often(0.3)
    several, preset = not specialize or often(0.6), str(rng.choice(("standard", "standard", "course")))
    scalars, backdrop = str(rng.choice(("", "", "", "vertices", "corners"))), often(0.15)
    settings = _settings(rng, shader, textured, scalars, backdrop)
    lanes, colored, only = int(rng.choice(LANES)), often(0.7), settings.edges is not None and settings.edges.only
    return Kind(
        settings=settings,
        preset=preset,  # type: ignore[arg-type]
        specialize=specialize,
        lanes=None if lanes == LANES[-1] else lanes,
        other_lanes=int(rng.choice([count for count in LANES if count != lanes])),
        orthographic=often(0.25),
        background=(often(0.7) or only) and not backdrop,
        double=often(0.7),
        several=several,
        front=several and not settings.cull and often(0.25),
        two_sided=lit and often(0.4),
        colored=colored,
        bright=colored and often(0.5),
        textured=textured,
        nearest=textured and often(0.3),
        uv_faces=textured and often(0.4),
        normal_faces=lit and preset == "standard" and often(0.3),
        alpha=textured and often(0.4),
        transparent=often(0.3),
        **{name: often(0.7) for name in ("ambient", "diffuse", "specular", "power")},
        maps=textured and shader == "pbr" and often(0.4),
        facets=shader == "pbr" and often(0.5),
        around=shader == "pbr" and often(0.4),
        backdrop=backdrop,
        shaped=lit and often(0.4),
        sized=lit and often(0.2),
        scalars=scalars,
    )


def _settings(rng: Random, shader: str, textured: bool, scalars: str, backdrop: bool) -> Settings:
    """Return settings: those of a preset, or any mixture of both presets', and further fields."""

    def often(share: float) -> bool:
        return bool(rng.random() < share)

    fields: dict[str, Any] = {
        "layers": "all",
        "cull": often(0.15),
        "precision": "float64" if often(0.15) else "float32",
    }
    base: Any = rng.choice(("standard", "course", "mixed"))
    if base == "mixed":
        declared = facts_of(Settings, "declared").items()
        choices = {name: facts.choices for name, facts in declared if name in PRESET_FIELDS["course"]}
        fields |= {name: str(rng.choice(values)) for name, values in choices.items()}
        base = "standard"
    fields["shader"] = shader
    if often(0.3):
        fields |= {"samples": 2, "sample_shading": often(0.3), "resolve": "weighted" if often(0.3) else "mean"}
    if textured and Settings.from_preset(base, **fields).texture_at == "pixel" and often(0.4):
        fields["texture_filter"] = "trilinear"
    if scalars:
        fields["scalars"] = "data"
    if backdrop:
        fields["background"] = "environment"
    if often(0.15):
        fields["edges"] = Edges("all", only=often(0.3))
    if shader != "nolight":
        fields["shadows"] = often(0.3)
        if often(0.2):
            fields["light_samples"] = int(rng.choice((1, 2, 3, 5, 16)))
        if often(0.2):
            fields["ambient_occlusion"] = int(rng.choice((1, 2, 3, 5)))
    return Settings.from_preset(base, **fields)
