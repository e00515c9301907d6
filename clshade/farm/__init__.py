"""Many frames of one scene, drawn by this process, by several on this machine, or by the workers of a Dask cluster."""

from .camera_files import read_cameras, write_cameras
from .cameras import orbit, stereo_cameras
from .frames import parse_frames
from .running import Run, draw_frames

__all__ = ["Run", "draw_frames", "orbit", "parse_frames", "read_cameras", "stereo_cameras", "write_cameras"]
