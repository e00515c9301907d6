"""What demo.py and demotmap.py share: the scene, drawing the figures with `clshade.course`, their files, the sheet."""

from __future__ import annotations

import argparse
import os
import sys
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

import numpy as np  # noqa: E402

import clshade  # noqa: E402
from clshade.errors import ClshadeError, InputError  # noqa: E402
from clshade.scene import Material, PointLight, Scene, Texture  # noqa: E402

SCENE, TEXTURE = "h3.npy", "cat_diff.png"  # used if they lie in the current folder
PANEL = 2.6  # inches, width of a panel of the sheet
DPI = 100


@dataclass
class Figure:
    """One figure: what of the scene it shows, and once it is drawn, the image (M, N, 3), row 0 at the bottom.

    terms: which of ambient, diffuse and specular light it shows. lights: indices. mapped: whether the texture is.
    """

    number: int
    shader: str
    what: str
    terms: tuple[str, ...] = ("ambient", "diffuse", "specular")
    lights: tuple[int, ...] = (0, 1, 2)
    mapped: bool = False
    image: np.ndarray = field(default_factory=lambda: np.zeros((1, 1, 3)))
    milliseconds: float = 0.0

    @property
    def title(self) -> str:
        return f"figure {self.number}: {self.shader}, {self.what}"

    @property
    def stem(self) -> str:
        return f"figure{self.number:02d}-{self.shader}-{self.what.replace(' ', '-')}"


# The scene


def parse(description: str, arguments: Sequence[str] | None) -> argparse.Namespace:
    """The command line of either demo."""
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument(
        "--scene", metavar="FILE", help=f"course scene (default: ./{SCENE} if there is one, else a built-in scene)"
    )
    parser.add_argument(
        "--texture",
        metavar="FILE",
        help=f"texture of demotmap.py (default: ./{TEXTURE} if there is one); demo.py draws the vertex colors",
    )
    parser.add_argument("--out", metavar="DIR", default=".", help="folder of the images (default: the current one)")
    parser.add_argument(
        "--resolution", metavar="N,M", help="columns and rows, in place of the scene's; the pixels become square"
    )
    parser.add_argument("--device", help="pocl, intel, part of a platform's name ... (default: CLSHADE_DEVICE, PoCL)")
    return parser.parse_args(arguments)


def _resolution(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    try:
        columns, rows = (int(part) for part in text.split(","))
    except ValueError:
        raise InputError(f"--resolution: expected two whole numbers such as 512,512, found {text!r}") from None
    return columns, rows


def find_scene(options: argparse.Namespace, mapped: bool) -> Scene:
    """The scene of the command line, of the current folder or the built-in one; with a texture if `mapped`."""
    texture = options.texture if options.texture or not os.path.isfile(TEXTURE) else TEXTURE
    path, resolution = options.scene, _resolution(options.resolution)
    if path is None and os.path.isfile(SCENE) and (texture or not mapped):
        path = SCENE
    if path is None:
        size = {} if resolution is None else {"resolution": resolution}
        scene = clshade.builtin("course", **size)
        if mapped and options.texture:
            scene = clshade.scenes.with_texture(scene, texture)
    else:
        if mapped and not texture:
            raise InputError(f"--texture: expected an image for {path}, found none")
        scene = clshade.load(path, texture=texture if mapped else None, resolution=resolution)
    if len(scene.lights) != 3:
        raise InputError(f"{scene.name}: lights: expected three, found {len(scene.lights)}")
    if scene.preset != "course":
        raise InputError(f"{path}: expected a course scene (.npy), found a mesh without lights and camera")
    return scene


def texels_of(scene: Scene) -> np.ndarray:
    texture = scene.meshes[0].material.texture
    assert isinstance(texture, Texture)
    return texture.image


# Drawing


def draw(scene: Scene, figure: Figure, size: tuple[int, int] | None = None) -> np.ndarray:
    """The figure by one call of `render_object` or `render_object_map`, with (N, M) columns and rows."""
    from clshade import course

    mesh, camera, material = scene.meshes[0], scene.camera, scene.meshes[0].material
    lights = [scene.lights[k] for k in figure.lights]
    columns, rows = size or camera.resolution
    height, width = camera.plane
    colors = np.ones_like(mesh.verts) if mesh.colors is None else mesh.colors
    view = (camera.focal, camera.eye, camera.lookat, camera.up, scene.background, rows, columns, height, width)
    light = (
        material.ka if "ambient" in figure.terms else 0.0,
        material.kd if "diffuse" in figure.terms else 0.0,
        material.ks if "specular" in figure.terms else 0.0,
        material.n,
        [light.position for light in lights],
        [light.intensity for light in lights],
        scene.ambient,
    )
    if figure.mapped:
        uv_faces = mesh.faces if mesh.uv_faces is None else mesh.uv_faces
        mapped = (mesh.verts.T, mesh.faces.T, mesh.uvs.T, uv_faces.T, texels_of(scene))
        return course.render_object_map(figure.shader, *view, *mapped, *light)
    return course.render_object(figure.shader, *view, mesh.verts.T, colors.T, mesh.faces.T, *light)


def build_all(scene: Scene, figures: Sequence[Figure]) -> None:
    """Has the programs of all figures built, by drawing one pixel with each."""
    for figure in {(figure.shader, figure.terms): figure for figure in figures}.values():
        draw(scene, figure, (1, 1))


def draw_all(scene: Scene, figures: Sequence[Figure]) -> Iterator[Figure]:
    """Draws and times each figure."""
    for figure in figures:
        start = time.perf_counter()
        figure.image = draw(scene, figure)
        figure.milliseconds = (time.perf_counter() - start) * 1e3
        yield figure


# Files


def save(scene: Scene, figure: Figure, folder: Path) -> None:
    """Writes the figure as EXR (linear, unclamped) and as PNG (clamped, as the course shows it)."""
    from clshade import exr, png
    from clshade.tonemap import tonemap

    image = np.ascontiguousarray(figure.image[::-1], dtype=np.float32)
    metadata = exr.camera_metadata(scene.camera)
    metadata.update(
        title=figure.title, scene=scene.name, settings="preset=course", renderTimeSeconds=figure.milliseconds / 1e3
    )
    exr.write(folder / f"{figure.stem}.exr", image, metadata=metadata)
    png.write(folder / f"{figure.stem}.png", tonemap(image, "none"))


# The contact sheet


def _numbers(vector: np.ndarray) -> str:
    return "(" + ", ".join(f"{x:.3g}" for x in vector) + ")"


def caption(scene: Scene, figure: Figure) -> str:
    """Position and intensity of the figure's lights, and the time it took."""
    lights = [scene.lights[k] for k in figure.lights]
    lines = [f"light at {_numbers(light.position)}, {_numbers(light.intensity)}" for light in lights]
    return "\n".join([*lines, f"{figure.milliseconds:.1f} ms"])


def _panel(canvas, place: int, shape: tuple[int, int], title: str, text: str):
    axes = canvas.add_subplot(*shape, place)
    axes.set_xticks(())
    axes.set_yticks(())
    axes.set_title(title, fontsize=8)
    axes.set_xlabel(text, fontsize=7)
    return axes


def sheet(scene: Scene, figures: Sequence[Figure], pairs: Sequence[tuple[Figure, Figure]], columns: int, path: Path):
    """All figures with captions, and for each pair (gouraud, phong) their difference, on one PNG."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure as Canvas

    rows = -(-(len(figures) + len(pairs)) // columns)
    canvas = Canvas(figsize=(PANEL * columns, (PANEL + 0.85) * rows + 0.4), dpi=DPI)
    for place, figure in enumerate(figures, 1):
        axes = _panel(canvas, place, (rows, columns), figure.title, caption(scene, figure))
        axes.imshow(np.clip(figure.image, 0.0, 1.0), origin="lower")
    for place, (gouraud, phong) in enumerate(pairs, len(figures) + 1):
        difference = np.abs(phong.image - gouraud.image).max(axis=2)
        title = f"|figure {phong.number} - figure {gouraud.number}|, phong - gouraud: {phong.what}"
        text = f"black: none, white: {max(difference.max(), 1e-6):.2g} (the largest)\nmean {difference.mean():.2g}"
        axes = _panel(canvas, place, (rows, columns), title, text)
        axes.imshow(difference, cmap="magma", vmin=0.0, vmax=max(difference.max(), 1e-6), origin="lower")
    name = f"{scene.name}, {scene.face_count} triangles, {scene.camera.resolution[0]} x {scene.camera.resolution[1]}"
    ambient = f"ambient light {_numbers(scene.ambient)}; times: one call, program built and scene on the device"
    canvas.suptitle(f"{name}; {ambient}", fontsize=8, y=1.0 - 0.12 / canvas.get_figheight())
    canvas.subplots_adjust(
        left=0.02, right=0.98, bottom=0.75 / canvas.get_figheight(), top=1.0 - 0.5 / canvas.get_figheight(), hspace=0.33
    )
    FigureCanvasAgg(canvas).print_png(str(path))


# The whole run


def _import_slow_modules() -> None:
    import matplotlib.backends.backend_agg
    import matplotlib.figure
    import OpenEXR
    import PIL.Image  # noqa: F401


def _run(
    options: argparse.Namespace,
    figures: Sequence[Figure],
    pairs: Sequence[tuple[Figure, Figure]],
    columns: int,
    sheet_name: str,
) -> None:
    from tqdm import tqdm

    importing = threading.Thread(target=_import_slow_modules, daemon=True)
    importing.start()
    if options.device:
        os.environ["CLSHADE_DEVICE"] = options.device
    scene = find_scene(options, figures[0].mapped)
    folder = Path(options.out)
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(f"{folder}: --out: expected a folder, found {error.strerror}") from None
    build_all(scene, figures)
    importing.join()
    with ThreadPoolExecutor(1) as writer:
        for figure in tqdm(draw_all(scene, figures), total=len(figures), unit="figure", desc=scene.name):
            pass
        written = [writer.submit(save, scene, figure, folder) for figure in figures]
        sheet(scene, figures, pairs, columns, folder / sheet_name)
        for result in written:
            result.result()
    print(f"{len(figures)} figures as .exr and .png and {sheet_name} in {folder.resolve()}")


def main(
    description: str,
    plan: Callable[[], tuple[list[Figure], list[tuple[Figure, Figure]]]],
    columns: int,
    sheet_name: str,
    arguments: Sequence[str] | None = None,
) -> int:
    """Runs a demo; returns its exit code: 0 done, 2 bad input, 130 interrupted."""
    options = parse(description, arguments)
    try:
        _run(options, *plan(), columns, sheet_name)
    except ClshadeError as error:
        print(f"{Path(sys.argv[0]).name}: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return 0


__all__ = ["Figure", "Material", "PointLight", "draw", "main"]
