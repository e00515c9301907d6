"""Kinds of random scenes. Building a kernel program takes seconds, so all that determines the program is a `Kind`, which the
scenes of a block share; everything else differs from scene to scene."""

from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from clshade.base.declare import facts_of
from clshade.scene.settings import PRESET_FIELDS, Edges, Preset, Settings

BLOCK = 50  # consecutive scenes of one kind
LANES = (1, 4, 8, 16)  # pixels per vector; the last is a CPU's default
KINDS = 80  # number of kinds; then they repeat
Random = np.random.Generator
TERMS = ("ambient", "diffuse", "specular", "power")
NAMES = """orthographic background double several front two_sided colored bright textured nearest uv_faces normal_faces alpha
transparent ambient diffuse specular power maps facets around backdrop shaped sized"""
FLAGS = frozenset(NAMES.split())


@dataclass(frozen=True)
class Kind:
    """All that determines the kernel program.

    specialize: whether the program leaves out unneeded features. Only then the flags apply, which are attributes: if one
    is set, the first mesh or light of the kind's scenes has the feature; otherwise none has. Otherwise all optional
    features are compiled in, and scenes have them or not. lanes: pixels per vector on a CPU; None: the device's default.
    other_lanes: for scenes that are drawn twice to compare the bits. scalars: whether a color map shows scalars of one
    more mesh, of its "vertices" or of its faces' "corners".

    Some flags: double: positions may need float64. bright: colors exceed 1. around, backdrop: an environment lights the
    scene, or is the background. shaped, sized: lights have directions, cones or attenuation, or sizes.
    """

    settings: Settings
    preset: Preset
    specialize: bool
    lanes: int | None
    other_lanes: int
    scalars: str
    flags: frozenset[str]

    def __getattr__(self, name: str) -> bool:
        if name not in FLAGS:
            raise AttributeError(name)
        return name in self.flags

    @property
    def dim(self) -> bool:
        """Whether no color may exceed 1."""
        return self.settings.shader in ("phong", "pbr") and not self.bright


def is_wanted(rng: Random, share: float, always: bool = False) -> bool:
    return always or bool(rng.random() < share)


def kind_of(seed: int, block: int) -> Kind:
    rng = np.random.default_rng([seed, block % KINDS, 0])
    often = partial(is_wanted, rng)
    shader = str(rng.choice(("phong", "gouraud", "nolight", "pbr")))
    lit, pbr, textured, specialize = shader != "nolight", shader == "pbr", often(0.6), often(0.3)
    several, preset = not specialize or often(0.6), str(rng.choice(("standard", "standard", "course")))
    scalars, backdrop = str(rng.choice(("", "", "", "vertices", "corners"))), often(0.15)
    settings = _settings(rng, shader, textured, scalars, backdrop)
    lanes, colored, only = int(rng.choice(LANES)), often(0.7), settings.edges is not None and settings.edges.only
    other_lanes = int(rng.choice([count for count in LANES if count != lanes]))
    flags = {
        "textured": textured,
        "several": several,
        "colored": colored,
        "backdrop": backdrop,
        "orthographic": often(0.25),
        "background": (often(0.7) or only) and not backdrop,
        "double": often(0.7),
        "front": several and not settings.cull and often(0.25),
        "two_sided": lit and often(0.4),
        "bright": colored and often(0.5),
        "nearest": textured and often(0.3),
        "uv_faces": textured and often(0.4),
        "normal_faces": lit and preset == "standard" and often(0.3),
        "alpha": textured and often(0.4),
        "transparent": often(0.3),
        **{name: often(0.7) for name in TERMS},
        "maps": textured and pbr and often(0.4),
        "facets": pbr and often(0.5),
        "around": pbr and often(0.4),
        "shaped": lit and often(0.4),
        "sized": lit and often(0.2),
    }
    named: Any = preset, specialize, None if lanes == LANES[-1] else lanes, other_lanes, scalars
    return Kind(settings, *named, frozenset(name for name, is_set in flags.items() if is_set))


def _settings(rng: Random, shader: str, textured: bool, scalars: str, backdrop: bool) -> Settings:
    """Return settings: those of a preset, or any mixture of both presets', and further fields."""
    often = partial(is_wanted, rng)
    fields: dict[str, Any] = {"layers": "all", "cull": often(0.15)}
    fields["precision"] = "float64" if often(0.15) else "float32"
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
        for name, counts in (("light_samples", (1, 2, 3, 5, 16)), ("ambient_occlusion", (1, 2, 3, 5))):
            if often(0.2):
                fields[name] = int(rng.choice(counts))
    return Settings.from_preset(base, **fields)
