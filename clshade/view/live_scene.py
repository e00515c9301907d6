"""The scene of a live view: where it comes from, and the renderers that draw it with the settings in use."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from typing import Any

from ..pipeline.effective_settings import effective_settings
from ..pipeline.frame import Frame
from ..pipeline.frame_files import SavingOptions
from ..pipeline.renderer import Renderer
from ..scene.adjust_camera import adjusted, camera_of
from ..scene.adjust_lights import scaled_lights
from ..scene.camera import Camera
from ..scene.model import Scene
from ..scene.settings import Layer, Settings

MOST_RENDERERS = 8  # open at a time, of all clients: each keeps the scene in device memory
LENS = ("view_angle", "orthographic")  # arguments of `adjusted` that are no pose


@dataclass(frozen=True)
class Source:
    """Where a scene comes from, and the options of `render` that say so.

    name: as the user gave it. load: reads it, with its own camera. files: watched for changes.
    camera, fit: of the first camera, see `camera_of`. settings: preset, resolution and fields of Settings.
    lights: factors of the lights' intensities at first, one for all or one each.
    options: of `render`, repeated in every command. saving: of snapshots. output: of snapshots, without a number.
    """

    name: str
    load: Callable[[], Scene]
    files: tuple[str, ...] = ()
    camera: Mapping[str, Any] = field(default_factory=dict)
    fit: bool = False
    settings: Mapping[str, Any] = field(default_factory=dict)
    lights: tuple[float, ...] = (1.0,)
    device: str | None = None
    options: tuple[str, ...] = ()
    saving: SavingOptions = field(default_factory=SavingOptions)
    output: str = "view"

    def stamps(self) -> tuple[Any, ...]:
        """Return what changes when a watched file does: size and time of each, None for a missing one."""
        return tuple(map(_stamp, self.files))


def _stamp(path: str) -> tuple[int, int, int] | None:
    try:
        found = os.stat(path)
    except OSError:
        return None
    return found.st_mtime_ns, found.st_size, found.st_ino


@dataclass(frozen=True)
class View:
    """What a picture depends on, besides the scene.

    camera: already with the lens and the resolution of the source. lights: a factor for each light's intensity.
    """

    camera: Camera
    settings: Settings
    lights: tuple[float, ...]


def in_motion(settings: Settings, *, layers: tuple[Layer, ...] = (), samples: int = 1) -> Settings:
    """Return the settings of pictures before the last one."""
    return replace(settings, samples=samples, sample_shading=False, layers=layers)


class LiveScene:
    """A scene, loaded, and renderers of it.

    One thread at a time may call it. version: counts loads. stamps: of the files when they were read.
    """

    def __init__(self, source: Source) -> None:
        self.source, self.version = source, 0
        self._renderers: dict[tuple[Settings, tuple[float, ...]], Renderer] = {}  # the latest last
        self._users: dict[tuple[Settings, tuple[float, ...]], set[object]] = {}
        self.load()

    def load(self) -> None:
        """Read the scene again. If that fails with a ClshadeError, the former one stays."""
        stamps = self.source.stamps()
        scene = self.source.load()
        fields = {name: value for name, value in self.source.settings.items() if name != "resolution"}
        _, settings = effective_settings(scene, **fields)
        camera = camera_of(scene, self.source.camera, fit=self.source.fit)
        first = self._at_resolution(camera)
        scaled_lights(scene, self.source.lights, "--light-intensity")  # refuses what the view could not use
        self.close()
        self.scene, self.settings, self.first_camera, self.stamps = scene, settings, first, stamps
        self.version += 1

    def first_view(self) -> View:
        factors, count = self.source.lights, len(self.scene.lights)
        return View(self.first_camera, self.settings, factors if len(factors) == count else factors[:1] * count)

    def placed(self, camera: Camera) -> Camera:
        """Return the camera that `render` makes of this one's pose and the source's lens."""
        lens = {name: value for name, value in self.source.camera.items() if name in LENS}
        pose = {"position": camera.eye, "focal_point": camera.lookat, "up": camera.up}
        return self._at_resolution(adjusted(self.scene.camera, **{**lens, **pose}))

    def _at_resolution(self, camera: Camera) -> Camera:
        resolution = self.source.settings.get("resolution")
        return camera if resolution is None else camera.with_resolution(resolution)

    def render(self, view: View, user: object = None) -> Frame:
        """Draw a frame. user: who asks; its renderers are closed by `release`."""
        key = view.settings, view.lights
        renderer = self._renderers.pop(key, None)
        if renderer is None:
            scene = replace(self.scene, camera=self.first_camera)
            if view.lights != (1.0,) * len(view.lights):
                scene = scaled_lights(scene, view.lights)
            renderer = Renderer(scene, settings=view.settings, device=self.source.device)
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

    def prepare(self) -> None:
        """Compile the kernels of the first and the last pictures, so that no client has to wait for them."""
        view = self.first_view()
        view = replace(view, camera=replace(view.camera, resolution=(16, 16)))
        self.render(replace(view, settings=in_motion(view.settings)), self)
        self.render(view, self)
        self.release(self)

    @property
    def open_renderers(self) -> int:
        return len(self._renderers)

    def _close(self, key: tuple[Settings, tuple[float, ...]]) -> None:
        self._users.pop(key, None)
        self._renderers.pop(key).close()
