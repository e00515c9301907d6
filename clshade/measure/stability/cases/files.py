"""Cases 28 and 29: extreme texture coordinates, and values that files must preserve."""

from __future__ import annotations

import itertools

import numpy as np

from ....errors import InputError
from ....images import png
from ....images.joint_tonemaps import JOINT
from ....images.tonemap import OPERATORS, tonemap
from ....oracle import texture
from ....scene.model import Lookup, Texture, Wrap
from . import lit
from .bench import Bench, Case, Outcome, against_oracle, worst

SPECIAL = (0.0, -0.0, 1.0, -1.0, 2.0, 0.5, 1e-30, -1e-30, 1 - 2.0**-40, 1e30, -1e30, 3e38, np.nan, np.inf, -np.inf)
SIZES = ((1, 1), (1, 5), (7, 1), (16, 9))  # columns, rows
KINDS: tuple[tuple[Lookup, Wrap], ...] = (
    ("standard", "repeat"),
    ("standard", "clamp"),
    ("standard", "mirror"),
    ("course", "repeat"),
)
MEAN = 8.0  # roundings of a mean of four texels: three differences and sums, each of at most twice the largest texel


def coordinates(bench: Bench) -> Outcome:
    """All pairs of special coordinates in textures from 1x1: the oracle's texel, nothing from outside the image."""
    outcomes = []
    uv = np.array(list(itertools.product(SPECIAL, repeat=2)))
    for (columns, rows), (lookup, wrap) in itertools.product(SIZES, KINDS):
        image = np.random.default_rng(columns + 100 * rows).uniform(-1, 1, (rows, columns, 3)).astype(np.float32)
        found = np.asarray(bench.look_up(Texture(image, wrap, lookup), uv), np.float64)
        expected = texture.bilerp(uv, image, lookup, wrap)
        slack = MEAN * 2.0**-24
        outside = ~((found >= image.min() - slack) & (found <= image.max() + slack))
        error = float(np.abs(found - expected).max() / 2.0**-24)
        outcomes.append(Outcome(int(outside.any(axis=1).sum()), error, MEAN, "2^-24", error))
    refused = [(0, 0), (0, 3), (3, 0)]
    for shape in refused:
        try:
            Texture(np.zeros((*shape, 3), np.float32))
        except InputError:
            continue
        outcomes.append(Outcome(1))
    image = np.random.default_rng(2).uniform(0, 1, (9, 16, 3)).astype(np.float32)
    mesh = lit.patch(material=lit.MATERIAL.__class__(texture=Texture(image)))
    uvs = np.resize(np.array(SPECIAL[:10]), (len(mesh.verts), 2))
    frame = bench.draw(lit.scene_of(lit.patch(material=mesh.material, uvs=uvs % 3.0)))
    outcomes.append(against_oracle(frame))
    return worst(outcomes, f"{len(uv)} coordinates, {len(SIZES) * len(KINDS)} textures; 0x0 refused")


def radiance(bench: Bench) -> Outcome:
    """1e6, NaN with its payload, infinity, -0.0 and denormals keep their bits in an EXR; half floats warn; in a PNG NaN
    becomes 0 and +infinity 255."""
    bits = np.array([0x7FC12345, 0xFFC00001, 0x7F800000, 0xFF800000, 0x80000000, 1, 0x007FFFFF, 0x49742400], np.uint32)
    plane = np.ascontiguousarray(np.resize(bits, (6, 8)).view(np.float32))
    plane[5] = [1e6, 65504.0, 65520.0, 3.4e38, -1e6, 0.5, 1e-8, 0.0]
    channels = {name: np.ascontiguousarray(np.roll(plane, i, axis=1)) for i, name in enumerate("RGBA")}
    wrong, warned = 0, []
    for options in ({}, {"compression": "none"}, {"compression": "piz"}, {"half": True}):
        found, warnings = bench.through_file(channels, **options)
        if options.get("half"):
            warned = warnings
            continue
        wrong += sum(int((found[name].view(np.uint32) != channels[name].view(np.uint32)).sum()) for name in channels)
    wrong += int(not warned)
    image = np.zeros((1, 4, 3), np.float32)
    image[0, :, 0] = np.nan, np.inf, -np.inf, 1e6
    path = bench.folder / "case.png"
    for operator in OPERATORS:
        codes = tonemap(image, operator, 0.0)
        wrong += int((codes[0, :, 0] != [0, 255, 0, 255]).sum())
        wrong += 0 if operator in JOINT else int((codes[..., 1:] != 0).sum())
        png.write(path, codes)
        wrong += int((png.read(path) != codes).sum())
    path.unlink(missing_ok=True)
    return Outcome(wrong, detail="EXR in three compressions, half, PNG by every tone map")


CASES = (
    Case("28", "texture-coordinates", "uv of NaN, infinity, 1e30; 1x1, 1xN", "a defined texel", coordinates, True),
    Case("29", "radiance-in-files", "1e6, NaN, infinity in EXR and PNG", "same bits; 0 and 255 in PNG", radiance),
)
