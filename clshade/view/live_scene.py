"""The scene of a live view: where it comes from, and the renderers that draw it with the settings in use."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any, TypeAlias

from ..base.input_files import stamp
from ..pipeline.effective_settings import effective_settings, picture_fields
from ..pipeline.frame import Frame
from ..pipeline.frame_files import SavingOptions
from ..pipeline.renderer import Renderer
from ..scene.adjust_camera import adjusted, camera_of
from ..scene.adjust_lights import scaled_lights
from ..scene.builtin.studio import studio_for
from ..scene.camera import Camera
from ..scene.environment import Environment
from ..scene.framing import Up, up_of
from ..scene.ground import with_ground
from ..scene.look import has_ground, with_look
from ..scene.model import Scene, Texture
from ..scene.settings import Layer, Look, Settings

MOST_RENDERERS = 8  # open at a time, of all clients: each keeps the scene in device memory
MOST_PIXELS = 1 << 22  # of a picture as large as its window
LENS = ("view_angle", "orthographic")  # arguments of `adjusted` that are no pose


@dataclass(frozen=True)
class Source:
    """Where a scene comes from, and the options of `render` that say so.

    name: as the user gave it. load: reads it. files: watched for changes.
    arrange: gives it the chosen lights and, by its name, an environment, None: its own; returns it as its look shows it
    without a ground, and this look. finish: what comes after the ground.
    camera, fit: of the first camera, see `camera_of`. settings: preset, resolution and fields of Settings.
    lights: factors of the lights' intensities at first, one for all or one each.
    ground, environment, environment_intensity: at first; ground None: as the look has it.
    up: the axis that points up in the file, None: the one nearest to its camera's.
    options: of `render`, repeated in every command. saving: of snapshots. output: of snapshots, without a number.
    """

    name: str
    load: Callable[[], Scene]
    arrange: Callable[[Scene, str | None], tuple[Scene, Look]]
    finish: Callable[[Scene], Scene]
    files: tuple[str, ...] = ()
    camera: Mapping[str, Any] = field(default_factory=dict)
    fit: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    lights: tuple[float, ...] = (1.0,)
    ground: bool | None = None
    environment: str | None = None
    environment_intensity: float | None = None
    up: Up | None = None
    device: str | None = None
    options: tuple[str, ...] = ()
    saving: SavingOptions = field(default_factory=SavingOptions)
    output: str = "view"

    def stamps(self) -> tuple[Any, ...]:
        """Return what changes when a watched file does: see `stamp`, None for a missing one."""
        return tuple(map(stamp, self.files))


@dataclass(frozen=True)
class View:
    """What a picture depends on, besides the scene.

    camera: already with the lens and the resolution. lights: a factor for each light's intensity.
    ground: whether there is one. environment: its name, see `Source.arrange`; None of its intensity: as the source says.
    view_angle: of the camera, degrees; None: as the scene or the source says.
    """

    camera: Camera
    settings: Settings
    lights: tuple[float, ...]
    ground: bool
    environment: str | None
    environment_intensity: float | None = None
    view_angle: float | None = None


_Key: TypeAlias = tuple[Any, ...]  # of a view, without its camera


def in_motion(settings: Settings, *, layers: tuple[Layer, ...] = (), samples: int = 1) -> Settings:
    """Return the settings of pictures before the last one."""
    return replace(settings, samples=samples, sample_shading=False, layers=layers)


class LiveScene:
    """A scene, loaded, and renderers of it.

    One thread at a time may call it, but for what only looks. version: counts loads. stamps: of the files when they were
    read. scene: with the lights and the environment of the source, without a ground.
    """

    def __init__(self, source: Source) -> None:
        self.source, self.version = source, 0
        self._renderers: dict[_Key, Renderer] = {}  # the latest last
        self._users: dict[_Key, set[object]] = {}
        self.load()

    def load(self) -> None:
        """Read the scene again. If that fails with a ClshadeError, the former one stays."""
        stamps = self.source.stamps()
        loaded = self.source.load()
        lit = self.source.arrange(loaded, self.source.environment)
        scene = lit[0]
        given = {name: value for name, value in self.source.settings.items() if name not in ("resolution", "preset")}
        preset = self.source.settings.get("preset")
        _, settings = effective_settings(scene, preset, **picture_fields(scene, preset, **given))
        camera = camera_of(scene, self.source.camera, fit=self.source.fit)
        first = self._at_resolution(camera)
        scaled_lights(scene, self.source.lights, "--light-intensity")  # refuses what the view could not use
        self.close()
        self._loaded, self._lit = loaded, {self.source.environment: lit}
        self._contact_shadow: Texture | None = None
        # The renderer chooses a distance of ambient occlusion, which depends on the ground.
        settings = replace(settings, ao_distance=given.get("ao_distance"))
        self.scene, self.settings, self.first_camera, self.stamps = scene, settings, first, stamps
        self.version += 1

    @property
    def takes_sizes(self) -> bool:
        """Whether pictures may be as large as a window: the source names no resolution, and the lens can be said."""
        return self.source.settings.get("resolution") is None and not self.scene.camera.orthographic

    def first_view(self, size: tuple[int, int] | None = None) -> View:
        """Return the view at first. size: of the window, columns and rows, None: the picture's own."""
        factors, count = self.source.lights, len(self.scene.lights)
        lights = factors if len(factors) == count else factors[:1] * count
        environment, ground = self.source.environment, self.source.ground
        ground = self.has_usual_ground(environment, self.settings) if ground is None else ground
        view = View(self.first_camera, self.settings, lights, ground, environment)
        return view if size is None or not self.takes_sizes else self._in_window(view, *size)

    def _in_window(self, view: View, columns: int, rows: int) -> View:
        """Return the view in a window of any shape: what was seen is seen, and more beside it or above and below."""
        shrunk = min(1.0, math.sqrt(MOST_PIXELS / (columns * rows)))
        size = max(1, int(columns * shrunk)), max(1, int(rows * shrunk))
        height, width = self.scene.camera.plane
        seen, angle = max(height, width * size[1] / size[0]), None
        # The camera of a glTF file depends on the resolution with which it is loaded.
        lens_varies = self.source.name.lower().endswith((".glb", ".gltf"))
        if self.source.camera.get("view_angle") is None and (lens_varies or seen > height):
            angle = math.degrees(2.0 * math.atan(0.5 * seen / self.scene.camera.focal))
        return replace(view, camera=self.placed(view.camera.with_resolution(size), angle), view_angle=angle)

    def placed(self, camera: Camera, view_angle: float | None) -> Camera:
        """Return the camera that `render` makes of this one's pose and resolution and of the source's lens."""
        lens = {name: value for name, value in self.source.camera.items() if name in LENS}
        lens |= {} if view_angle is None else {"view_angle": view_angle}
        pose = {"position": camera.eye, "focal_point": camera.lookat, "up": camera.up}
        found = adjusted(self.scene.camera, **{**lens, **pose})
        as_it_is = self.source.settings.get("resolution") is None and found.resolution == camera.resolution
        return found if as_it_is else found.with_resolution(camera.resolution)

    def _at_resolution(self, camera: Camera) -> Camera:
        resolution = self.source.settings.get("resolution")
        return camera if resolution is None else camera.with_resolution(resolution)

    def lit(self, environment: str | None) -> Scene:
        """Return the scene in an environment, as its look shows it without a ground."""
        return self._lit_with_look(environment)[0]

    def look(self, environment: str | None) -> Look:
        """Return the look of the scene in an environment."""
        return self._lit_with_look(environment)[1]

    def _lit_with_look(self, environment: str | None) -> tuple[Scene, Look]:
        if environment not in self._lit:
            self._lit[environment] = self.source.arrange(self._loaded, environment)
        return self._lit[environment]

    def has_usual_ground(self, environment: str | None, settings: Settings) -> bool:
        """Return whether `render` draws a ground there if no option speaks of it."""
        return has_ground(self.look(environment), settings.edges)

    def surroundings(self, view: View) -> Environment | None:
        """Return the environment that is there to see behind the surfaces."""
        scene = self.lit(view.environment)
        lit_by_studio = view.settings.shader == "pbr" and not scene.own_lights
        found = scene.environment or (studio_for(scene) if lit_by_studio else None)
        if found is None or view.environment_intensity is None:
            return found
        return replace(found, intensity=view.environment_intensity)

    def _arranged(self, view: View) -> Scene:
        scene = replace(self.lit(view.environment), camera=self.first_camera)
        if view.environment_intensity is not None:
            scene = replace(scene, environment=self.surroundings(view))
        if view.lights != (1.0,) * len(view.lights):
            scene = scaled_lights(scene, view.lights)
        return self.source.finish(self._grounded(scene, view) if view.ground else scene)

    def _grounded(self, scene: Scene, view: View) -> Scene:
        """Return the scene on a ground, that of its look."""
        up, settings = self.source.up or up_of(self._loaded.camera), view.settings
        look = self.look(view.environment)
        if look != "studio":
            return with_ground(scene, up, settings)
        shadow = False if settings.ambient_occlusion else self._contact_shadow or True
        scene = with_look(scene, look, contact_shadow=shadow, up=up, settings=settings)
        self._contact_shadow = scene.meshes[-1].material.texture or self._contact_shadow
        return scene

    def render(self, view: View, user: object = None) -> Frame:
        """Draw a frame. user: who asks; its renderers are closed by `release`."""
        key = view.settings, view.lights, view.ground, view.environment, view.environment_intensity
        renderer = self._renderers.pop(key, None)
        if renderer is None:
            renderer = Renderer(self._arranged(view), settings=view.settings, device=self.source.device)
        self._renderers[key] = renderer
        self._users.setdefault(key, set()).add(user)
        while len(self._renderers) > MOST_RENDERERS:
            self._close(next(iter(self._renderers)))
        return renderer.render(view.camera)

    def release(self, user: object) -> None:
        """Close the renderers that only this user had."""
        for key, users in list(self._users.items()):
            users.discard(user)
            if not users:
                self._close(key)

    def close(self) -> None:
        """Close all renderers."""
        for key in list(self._renderers):
            self._close(key)

    def prepare(self, *, last: bool) -> None:
        """Compile the kernels of the first pictures of a view, or of its last."""
        view = self.first_view()
        settings = view.settings if last else in_motion(view.settings)
        self.render(replace(view, camera=replace(view.camera, resolution=(16, 16)), settings=settings), self)
        self.release(self)

    @property
    def open_renderers(self) -> int:
        return len(self._renderers)

    def _close(self, key: _Key) -> None:
        self._users.pop(key, None)
        self._renderers.pop(key).close()
