"""What keeps its rounding to nearest when a program's other operations round at random, and why."""

from __future__ import annotations

COVERAGE = "decides which triangle a sample shows: exact, or right by its own bound"
PAIRS = "unevaluated sums of two floats, whose errors are exact only where operations round to nearest"

FILES = {
    "samples.clh": COVERAGE,
    "triangle_lanes.clh": COVERAGE,
    "ownership.clh": COVERAGE,
    "tile_order.clh": COVERAGE,
    "fill_blocks.clh": COVERAGE,
    "fill.clh": COVERAGE,
    "fragment_order.clh": COVERAGE,
    "peel.clh": COVERAGE,
    "tile.clh": COVERAGE,
    "shown_lines.clh": COVERAGE,
    "pair_vectors.clh": PAIRS,
    "hierarchy.clh": "boxes that must hold their triangles, whatever the rounding",
    "shadow_predicate.clh": "signs of determinants in pairs of floats, right by their own bound",
    "shadow_packets.clh": "which boxes a ray may meet: margins cover rounding to nearest",
    "shadow_fans.clh": "which boxes a ray may meet: margins cover rounding to nearest",
    "single_rays.clh": "which boxes a ray may meet: margins cover rounding to nearest",
    "shadow_traversal.clh": "which boxes a ray may meet: margins cover rounding to nearest",
}

FUNCTIONS = {
    "inverse_depths": COVERAGE,
    "inverse_depth_pairs": COVERAGE,
    "edge_pairs": PAIRS,
    "pair_of_ints": PAIRS,
    "ds_sum": PAIRS,
    "ds_product": PAIRS,
    "ds_quotient": PAIRS,
    "pair_modulo": PAIRS,
    "pair_position": PAIRS,
    "wrapped": PAIRS,
    "on_plane": PAIRS,
    "over": PAIRS,
    "fp_quotient": PAIRS,
    "float_pairs_of": PAIRS,
    "put_plane": "adds and takes away 1.5 * 2^23 units to round to whole units",
    "exp2_negative_each": "adds and takes away 1.5 * 2^23 to find the nearest integer; its polynomial is moved",
}
