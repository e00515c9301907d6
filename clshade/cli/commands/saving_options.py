"""Options for writing images, and the keyword arguments of `Frame.save` that they mean."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from .arguments import names, refuse

OUTPUT = "output: files, and what they hold"  # title of the group of options

if TYPE_CHECKING:
    from ...pipeline.frame_files import SavingOptions


def saving_options(group: argparse._ArgumentGroup) -> list[str]:
    """Add the options; return their names in the namespace."""
    from ...images.depth_png import SCALE
    from ...images.exr import COMPRESSIONS
    from ...images.tonemap import OPERATORS
    from ...pipeline.frame_files import KINDS

    before = len(group._group_actions)
    group.add_argument(
        "--formats",
        type=names(KINDS, words={"z": "depth", "numpy": "npz", "openexr": "exr"}),
        metavar="NAME,...",
        help="files to write: exr, png, npz (all arrays, K and pose, for numpy.load), depth (OUT.depth.png, 16 bits, with "
        "layer Z) (default: exr,png; of OUT.npz that alone)",
    )
    group.add_argument(
        "--depth-scale",
        type=float,
        metavar="UNITS",
        help=f"scene units of a step of the depth PNG, which its text depthScale has (default: {SCALE:g})",
    )
    group.add_argument(
        "--tonemap",
        choices=OPERATORS,
        help="of the PNG (default: by the preset: none for course, neutral for pbr, srgb for standard)",
    )
    group.add_argument("--exposure", type=float, default=0.0, metavar="STOPS", help="of the PNG (default: 0)")
    group.add_argument("--half", action="store_true", help="16-bit floats in the EXR")
    group.add_argument(
        "--compression",
        default="zip",
        metavar="NAME",
        help=f"of the EXR: {', '.join(COMPRESSIONS)} (default: zip); lossy ones leave layers as they are, in a second part",
    )
    group.add_argument(
        "--crop", action="store_true", help="keep of the EXR what is not background, if that is black or none"
    )
    group.add_argument("--colorbar", action="store_true", help="add the color map of --scalars to the right of the PNG")
    group.add_argument("--deterministic", action="store_true", help="leave times out of the EXR")
    return [action.dest for action in group._group_actions[before:]]


def matte_option(group: argparse._ArgumentGroup) -> None:
    """Add the option for Cryptomatte layers."""
    from ...images.cryptomatte import MATTES

    group.add_argument(
        "--cryptomatte",
        type=names(MATTES),
        nargs="?",
        const=MATTES,
        metavar="NAME,...",
        help="also masks of each object, material and instance with the share of each pixel, as Cryptomatte layers in the "
        "EXR; or of those named alone, such as object,material",
    )


def chosen_saving(arguments: argparse.Namespace) -> SavingOptions:
    """Return the keyword arguments of `Frame.save`."""
    from ...images.depth_png import SCALE
    from ...pipeline.frame_files import SAVING, default_files

    if "depth" not in (arguments.formats or ()):
        refuse(arguments, ("depth_scale",), "needs --formats depth")
    saving: Any = {name: getattr(arguments, name) for name in SAVING if name != "files"}
    saving["files"] = arguments.formats or default_files(arguments.output or "")
    saving["depth_scale"] = SCALE if arguments.depth_scale is None else arguments.depth_scale
    chosen: SavingOptions = saving
    return chosen
