"""Many frames of one scene, drawn by this process, by several on this machine, or by the workers of a Dask cluster."""

from .camera_files import read_cameras, write_cameras
from .frames import orbit, parse_frames, stereo_cameras
from .running import Run, draw_frames

__all__ = ["Run", "draw_frames", "orbit", "parse_frames", "read_cameras", "stereo_cameras", "write_cameras"]
