"""Calls of the public API that mypy accepts, and calls that it must refuse: it reports each `ignore` without an error.

Never run: mypy reads it with the package.
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

import clshade

light = clshade.PointLight((1, 2, 3), 0.5)
camera = clshade.Camera.from_fov((0, 0, 5), [0, 0, 0], np.array([0, 1, 0]), 35.0)
material = replace(clshade.Material(kd=(0.5, 0.4, 0.3), n=40), ks=0.0)
texture = clshade.Texture(np.zeros((2, 2, 3), np.uint8), wrap=("repeat", "clamp"))
mesh = clshade.Mesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.array([[0, 1, 2]]), material=material)
mesh = clshade.Mesh(vertices=mesh.vertices, faces=mesh.faces, name="the same", uvs=[[0, 0]] * 3)
mesh = replace(clshade.Mesh(mesh.verts, mesh.faces, np.ones((3, 3))), instances=None, scalars={"heat": [1, 2, 3]})
scene = clshade.Scene([mesh], camera, [light], ambient=0.2, background=None)
scene = replace(scene, ambient=(0.1, 0.1, 0.1), lights=light)
sun = clshade.DirectionalLight((0, -1, 0))
lamp = clshade.SpotLight((0, 2, 0), (0, -1, 0), 3.0, attenuation="inverse-square")
panel = clshade.RectangleLight([0, 2, 0], right=(1, 0, 0), up=np.array([0, 0, 1]), intensity=3)
around = clshade.Environment(np.ones((1, 2, 3)), up=[0, 0, 1])
scene = replace(scene, lights=[sun, lamp, light, panel], environment=around)
frame = clshade.render(scene, shader="phong", layers=["Z", "id"], samples=4, resolution=(64, 48), preset="standard")
frame = clshade.render(scene, settings=clshade.Settings.from_preset("course", layers="all"), device="pocl")
with clshade.Renderer(scene, resolve="weighted", samples=8) as renderer:
    frames = [renderer.render(camera.with_resolution((32, 24)))]
    views = renderer.render_many((camera, camera), out={"Z": np.zeros((2, 600, 800), np.float32)})
shown: clshade.Frame = views[0]
depths: NDArray[np.float32] = views["Z"]
brighter: NDArray[np.floating] = frame.rgb * 2.0
numbers: NDArray[np.uint32] = frame["id"]
places: NDArray[np.float64] = frame["P"]
verts: NDArray[np.floating] = mesh.verts
placed: NDArray[np.float64] = mesh.instances
eye: NDArray[np.float64] = camera.eye
arms: NDArray[np.float64] = panel.right
sky: NDArray[np.float32] = texture.image
parts: tuple[clshade.Mesh, ...] = scene.meshes
wraps: tuple[str, str] = texture.wrap
lines: list[str] = frame.save("image", tonemap="aces", exposure=1.0, half=True, compression="piz")
error: float = clshade.check(frame, "all").error
warnings: list[str] = clshade.exr.write("a.exr", {"R": frame.rgb[..., 0]}, compression="zip", window="drawn")
lit: NDArray[np.float64] = clshade.course.light((0, 0, 0), (0, 0, 1), 1, (0, 0, 5), 0.1, 0.8, 0.5, 20, [], [])
numbered = clshade.farm.parse_frames("1..10")
cameras = clshade.farm.orbit(camera, numbered.numbers, numbered)
run = clshade.farm.draw_frames(scene, cameras, "out.##.exr", saving={"half": True}, preset="course", cull=True)
loaded = clshade.load("a.stl", texture=np.zeros((2, 2, 3)), up="z", crease=30)

# Refused
clshade.render(scene, shadr="phong")  # type: ignore[call-arg]
clshade.render(scene, shader="phongg")  # type: ignore[arg-type]
clshade.render(scene, layers=["z"])  # type: ignore[list-item]
clshade.render(scene, preset="courses")  # type: ignore[arg-type]
clshade.Renderer(scene, sampels=4)  # type: ignore[call-arg]
clshade.Settings(visibility="z-buffer")  # type: ignore[arg-type]
clshade.Settings.from_preset("standard", resolution=(4, 4))  # type: ignore[call-arg]
frame.rgb + "a"  # type: ignore[operator]
frame.save("image", tonmap="aces")  # type: ignore[call-arg]
frame.save("image", compression="zap")  # type: ignore[arg-type]
clshade.load("a.stl", up="w")  # type: ignore[arg-type]
clshade.Camera((0, 0, 5), (0, 0, 0), (0, 1, 0))  # type: ignore[call-arg]
clshade.PointLight()  # type: ignore[call-arg]
clshade.Mesh(vertices=[], verts=[], faces=[])  # type: ignore[call-overload]
clshade.Mesh([], [], colour=None)  # type: ignore[call-overload]
clshade.Mesh(vertices=[], faces=[], name=1)  # type: ignore[call-overload]
clshade.Environment()  # type: ignore[call-arg]
clshade.Texture(np.zeros((1, 1, 3)), wrap=1)  # type: ignore[arg-type]
clshade.Scene()  # type: ignore[call-arg]
clshade.course.render_object("phongg", **{})  # type: ignore[arg-type]
clshade.farm.draw_frames(scene, {}, "a", saving={"halb": True})  # type: ignore[arg-type]
