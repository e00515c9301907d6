"""Synonyms of layer names, for suggestions on a misspelled or foreign name."""

from __future__ import annotations

LAYER_WORDS = {
    **dict.fromkeys(("depth", "depths", "distance", "zbuffer", "z_buffer"), "Z"),
    **dict.fromkeys(("normal", "normals", "nrm"), "N"),
    **dict.fromkeys(("position", "positions", "pos", "points", "world_position"), "P"),
    **dict.fromkeys(("ids", "face", "faces", "face_id", "triangle_id", "index"), "id"),
    **dict.fromkeys(("object", "objects", "mesh", "mesh_id", "segmentation"), "object_id"),
    **dict.fromkeys(("material", "materials"), "material_id"),
    **dict.fromkeys(("instance", "instances", "placement", "placement_id"), "instance_id"),
    **dict.fromkeys(("base_color", "basecolor", "diffuse", "reflectance"), "albedo"),
    **dict.fromkeys(("scalars", "values", "data"), "scalar"),
    **dict.fromkeys(("ao", "occlusion", "ambient_occlusion"), "AO"),
    **dict.fromkeys(("uvs", "st", "texcoord", "texcoords", "texture_coordinates"), "uv"),
}
