"""The scene of a live view: its source, the renderers that draw it with the settings in use, and the command for a view."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from ..base.declare import as_argument, as_option
from ..base.input_files import stamp
from ..images.tonemap import Operator
from ..pipeline.effective_settings import changed_fields, effective_settings, picture_fields
from ..pipeline.frame import Frame
from ..pipeline.frame_files import SavingOptions
from ..pipeline.renderer import Renderer
from ..scene.adjust_camera import adjusted, camera_of
from ..scene.builtin.studio import studio_for
from ..scene.camera import Camera
from ..scene.environment import Environment
from ..scene.framing import Up, up_of
from ..scene.ground import with_ground
from ..scene.look import has_ground, scaled_lights, with_look
from ..scene.model import Scene, Texture, default_tonemap
from ..scene.settings import Layer, Look, Settings

MAX_RENDERERS = 8  # open at a time, for all clients: each keeps the scene in device memory
MAX_PIXELS = 1 << 22  # of a picture as large as its window
REPEATED = ("scalars", "edges")  # fields of Settings that no client changes: the source's options have them


@dataclass(frozen=True)
class Source:
    """Where a scene comes from, and the options of `render` that say so; `lights` to `environment_intensity` are the first
    ones of the view."""

    name: str  # as the user gave it
    load: Callable[[], Scene]
    # Gives it the chosen lights and the environment of a name, its own for None; returns it with its look but without a
    # ground, and this look.
    arrange: Callable[[Scene, str | None], tuple[Scene, Look]]
    finish: Callable[[Scene], Scene]  # applies what follows the ground
    files: tuple[str, ...] = ()  # watched for changes
    camera: Mapping[str, Any] = field(default_factory=dict)  # with `fit` of the first camera, see `camera_of`
    fit: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)  # preset, resolution and fields of Settings
    lights: tuple[float, ...] = (1.0,)  # factors of intensities, one for all or one for each light
    ground: bool | None = None  # None: as the look has it
    environment: str | None = None
    environment_intensity: float | None = None
    up: Up | None = None  # the axis that points up in the file; None: the one nearest to its camera's
    device: str | None = None
    options: tuple[str, ...] = ()  # of `render`, repeated in every command
    saving: SavingOptions = field(default_factory=SavingOptions)  # of snapshots
    output: str = "view"  # of snapshots, without a number

    def stamps(self) -> tuple[Any, ...]:
        """Return the `stamp` of each watched file, None for a missing one."""
        return tuple(map(stamp, self.files))


@dataclass(frozen=True)
class View:
    """What a picture depends on, besides the scene."""

    camera: Camera  # with lens and resolution
    settings: Settings
    lights: tuple[float, ...]  # a factor for each light's intensity
    ground: bool
    environment: str | None  # its name, see `Source.arrange`
    environment_intensity: float | None = None  # None: the source's
    view_angle: float | None = None  # the camera's, degrees; None: that of the scene or the source


_Key: TypeAlias = tuple[Any, ...]  # of a view, without its camera


def in_motion(settings: Settings, *, layers: tuple[Layer, ...] = (), samples: int = 1) -> Settings:
    """Return the settings of pictures before the last one."""
    return replace(settings, samples=samples, sample_shading=False, layers=layers)


class LiveScene:
    """A scene, loaded, and renderers of it.

    One thread at a time may call it, except for what only looks. version: counts loads. stamps: of the files when they
    were read. scene: with the lights and the environment of the source, without a ground. renderers: of a view's key,
    each with its users, the latest last.
    """

    def __init__(self, source: Source) -> None:
        self.source, self.version = source, 0
        self.renderers: dict[_Key, tuple[Renderer, set[object]]] = {}
        self.load()

    def load(self) -> None:
        """Read the scene again. If that fails with a ClshadeError, the former one stays."""
        source, stamps = self.source, self.source.stamps()
        loaded = source.load()
        lit = source.arrange(loaded, source.environment)
        scene, _ = lit
        chosen = {"preset": None, "resolution": None, **source.settings}
        preset, resolution = chosen.pop("preset"), chosen.pop("resolution")
        _, settings = effective_settings(scene, preset, **picture_fields(scene, preset, **chosen))
        camera = camera_of(scene, source.camera, fit=source.fit)
        camera = camera if resolution is None else camera.with_resolution(resolution)
        scaled_lights(scene, source.lights, "--light-intensity")  # refuses what the view could not use
        self.close()
        self._loaded, self._lit = loaded, {source.environment: lit}
        self._contact_shadow: Texture | None = None
        # The renderer chooses a distance of ambient occlusion, which depends on the ground.
        self.settings = replace(settings, ao_distance=chosen.get("ao_distance"))
        self.scene, self.first_camera, self.stamps = scene, camera, stamps
        self.version += 1

    @property
    def takes_sizes(self) -> bool:
        """Whether pictures may be as large as a window: the source has no resolution, and an option can set the lens."""
        return self.source.settings.get("resolution") is None and not self.scene.camera.orthographic

    def first_view(self, window: tuple[int, int] | None = None) -> View:
        """Return the first view. window: its columns and rows; None: the picture's own."""
        factors, count = self.source.lights, len(self.scene.lights)
        lights = factors if len(factors) == count else factors[:1] * count
        environment, ground = self.source.environment, self.source.ground
        ground = self.has_default_ground(environment, self.settings) if ground is None else ground
        view = View(self.first_camera, self.settings, lights, ground, environment)
        return view if window is None or not self.takes_sizes else self._in_window(view, *window)

    def _in_window(self, view: View, columns: int, rows: int) -> View:
        """Return the view in a window of any shape, which shows what the scene's own does, and more at two sides."""
        reduction = min(1.0, math.sqrt(MAX_PIXELS / (columns * rows)))
        size = max(1, int(columns * reduction)), max(1, int(rows * reduction))
        height, width = self.scene.camera.plane
        visible, angle = max(height, width * size[1] / size[0]), None
        # The camera of a glTF file depends on the resolution with which it is loaded.
        lens_varies = self.source.name.lower().endswith((".glb", ".gltf"))
        if self.source.camera.get("view_angle") is None and (lens_varies or visible > height):
            angle = math.degrees(2.0 * math.atan(0.5 * visible / self.scene.camera.focal))
        return replace(view, camera=self.placed(view.camera.with_resolution(size), angle), view_angle=angle)

    def placed(self, camera: Camera, view_angle: float | None) -> Camera:
        """Return the camera that `render` makes of this one's pose and resolution and of the source's lens."""
        lens = {name: value for name, value in self.source.camera.items() if name in ("view_angle", "orthographic")}
        lens |= {} if view_angle is None else {"view_angle": view_angle}
        eye, target, up = camera.eye, camera.lookat, camera.up
        placed = adjusted(self.scene.camera, **lens, position=eye, focal_point=target, up=up)
        fits = self.source.settings.get("resolution") is None and placed.resolution == camera.resolution
        return placed if fits else placed.with_resolution(camera.resolution)

    def lit(self, environment: str | None) -> tuple[Scene, Look]:
        """Return the scene in an environment with its look but without a ground, and this look."""
        if environment not in self._lit:
            self._lit[environment] = self.source.arrange(self._loaded, environment)
        return self._lit[environment]

    def has_default_ground(self, environment: str | None, settings: Settings) -> bool:
        """Return whether `render` draws a ground there without an option for it."""
        return has_ground(self.lit(environment)[1], settings.edges)

    def surroundings(self, view: View) -> Environment | None:
        """Return the environment that may be visible behind the surfaces."""
        scene, _ = self.lit(view.environment)
        lit_by_studio = view.settings.shader == "pbr" and not scene.own_lights
        environment = scene.environment or (studio_for(scene) if lit_by_studio else None)
        if environment is None or view.environment_intensity is None:
            return environment
        return replace(environment, intensity=view.environment_intensity)

    def _arranged(self, view: View) -> Scene:
        scene, look = self.lit(view.environment)
        scene = replace(scene, camera=self.first_camera)
        if view.environment_intensity is not None:
            scene = replace(scene, environment=self.surroundings(view))
        if view.lights != (1.0,) * len(view.lights):
            scene = scaled_lights(scene, view.lights)
        up, settings = self.source.up or up_of(self._loaded.camera), view.settings
        if view.ground and look == "studio":
            shadow = False if settings.ambient_occlusion else self._contact_shadow or True
            scene = with_look(scene, look, contact_shadow=shadow, up=up, settings=settings)
            self._contact_shadow = scene.meshes[-1].material.texture or self._contact_shadow
        elif view.ground:
            scene = with_ground(scene, up, settings)
        return self.source.finish(scene)

    def render(self, view: View, user: object = None) -> Frame:
        """Draw a frame. user: its renderers are closed by `release`."""
        key = view.settings, view.lights, view.ground, view.environment, view.environment_intensity
        renderer, users = self.renderers.pop(key, (None, set()))
        if renderer is None:
            renderer = Renderer(self._arranged(view), settings=view.settings, device=self.source.device)
        self.renderers[key] = renderer, users | {user}
        while len(self.renderers) > MAX_RENDERERS:
            self._close(next(iter(self.renderers)))
        return renderer.render(view.camera)

    def release(self, user: object) -> None:
        """Close the renderers that only this user had."""
        for key, (_, users) in list(self.renderers.items()):
            users.discard(user)
            if not users:
                self._close(key)

    def close(self) -> None:
        """Close all renderers."""
        for key in list(self.renderers):
            self._close(key)

    def _close(self, key: _Key) -> None:
        self.renderers.pop(key)[0].close()

    def prepare(self, *, last: bool) -> None:
        """Compile the kernels of the first pictures of a view, or of its last."""
        view = self.first_view()
        settings = view.settings if last else in_motion(view.settings)
        self.render(replace(view, camera=replace(view.camera, resolution=(16, 16)), settings=settings), self)
        self.release(self)

    def command(self, view: View, tonemap: Operator | None, exposure: float) -> list[str]:
        """Return the command line of `render` that draws a view, bit for bit, without an output."""
        source, camera = self.source, view.camera
        scene, look = self.lit(view.environment)
        preset = source.settings.get("preset") or scene.preset
        unlit = view.environment == "none"  # by an environment, which then has no direction nor intensity
        repeated = [option for option in source.options if not (unlit and option.startswith("--environment-"))]
        intensity = source.environment_intensity if view.environment_intensity is None else view.environment_intensity
        has_size = source.settings.get("resolution") is not None or camera.resolution == scene.camera.resolution
        default_ground = self.has_default_ground(view.environment, view.settings)
        is_scaled = look != "studio" and any(factor != 1.0 for factor in view.lights)
        options = {  # None: as without the option
            "environment": view.environment,
            "environment_intensity": None if unlit else intensity,
            "look": None if look == "plain" and scene.own_lights else look,
            "ground": None if view.ground == default_ground else view.ground,
            "camera_position": tuple(camera.eye.tolist()),
            "camera_focal_point": tuple(camera.lookat.tolist()),
            "camera_view_up": tuple(camera.up.tolist()),
            "camera_view_angle": view.view_angle,
            "resolution": None if has_size else camera.resolution,
            "light_intensity": view.lights if is_scaled else None,
            "tonemap": None if tonemap == default_tonemap(scene) else tonemap,
            "exposure": exposure or None,
        }
        chosen = [as_option(name, value) for name, value in options.items() if value is not None]
        changed = changed_fields(view.settings, scene, preset)
        chosen += [as_option(name, value) for name, value in changed.items() if name not in REPEATED]
        return ["clshade", "render", as_argument(source.name), *repeated, *chosen]
