"""Option of `render` for optical flow to other cameras."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING

from ...base.atomic_files import shown
from ...errors import InputError

if TYPE_CHECKING:
    from ...pipeline.frame import Frame
    from ...scene.camera import Camera
    from ...scene.model import Scene


def flow_option(group: argparse._ArgumentGroup) -> None:
    group.add_argument(
        "--flow-to",
        metavar="CAMERAS.json",
        help="optical flow in the EXR, pixels to the right and down: to the first camera of a list as of `animate` (flow), "
        "and to a second one (flow_back); what is occluded there (flow_occluded, flow_back_occluded), and the layer id",
    )


def flow_cameras(scene: Scene, arguments: argparse.Namespace) -> tuple[Camera, ...]:
    """Return the cameras of --flow-to, one or two; none without it."""
    if arguments.flow_to is None:
        return ()
    if arguments.formats is not None and not {"exr", "npz"} & set(arguments.formats):
        formats = ",".join(arguments.formats)
        raise InputError(f"--flow-to: needs exr or npz in --formats, which hold the flow, not {formats}")
    from ...farm import read_cameras

    base = scene.camera if arguments.resolution is None else scene.camera.with_resolution(arguments.resolution)
    cameras = read_cameras(arguments.flow_to, base)
    if len(cameras) > 2:
        raise InputError(f"--flow-to: expected one camera or two in {shown(arguments.flow_to)}, found {len(cameras)}")
    return cameras


def add_flows(frame: Frame, cameras: tuple[Camera, ...], arguments: argparse.Namespace) -> None:
    """Compute a frame's flows to the cameras."""
    if cameras:
        from ...pipeline.flow import flow
        from ...pipeline.flow_vectors import FLOWS

        found = [flow(frame, camera, device=arguments.device) for camera in cameras]
        frame.flows = dict(zip(FLOWS, found, strict=False))
