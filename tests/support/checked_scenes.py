"""Built-in scenes that tests/measure/test_checking.py compares with the oracle, and tests/pipeline/test_frames.py therefore
does not."""

from __future__ import annotations

# (scene, preset, shader): every scene with every shader, and with both presets.
CHECKED = [
    ("teapot", "course", "phong"),
    ("teapot", "standard", "gouraud"),
    ("teapot", "course", "nolight"),
    ("course", "standard", "phong"),
    ("course", "standard", "gouraud"),
    ("course", "course", "nolight"),
    ("box_room", "standard", "phong"),
    ("box_room", "course", "gouraud"),
    ("box_room", "standard", "nolight"),
    ("quads", "standard", "phong"),
    ("quads", "course", "gouraud"),
    ("quads", "course", "nolight"),
    ("icosphere", "standard", "phong"),
    ("icosphere", "course", "gouraud"),
    ("icosphere", "standard", "nolight"),
]
