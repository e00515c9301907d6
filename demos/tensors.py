"""Views of a scene as a data set: images and layers in files that are memory-mapped, and as tensors that share memory.

python demos/tensors.py [--views K] [--out DIR]

Writes DIR/rgba.npy, Z.npy and id.npy, each of all views; then hands the arrays to NumPy, PyTorch and JAX by DLPack, as far
as they are installed, and says whether any copied them.
"""

from __future__ import annotations

import argparse
import importlib
import sys
from pathlib import Path
from typing import Any

CHECKOUT = Path(__file__).resolve().parent.parent
if (CHECKOUT / "clshade").is_dir():  # run from a checkout, installed or not
    sys.path.insert(0, str(CHECKOUT))

from clshade.base import interrupts  # noqa: E402

if __name__ == "__main__":
    interrupts.leave_soon()  # the rest takes long to import

import numpy as np  # noqa: E402

import clshade  # noqa: E402
from clshade.base.text_tables import create_folder  # noqa: E402
from clshade.errors import ClshadeError  # noqa: E402

LAYERS = ("Z", "id")
RESOLUTION = (160, 120)


def mapped(folder: Path, views: int) -> dict[str, np.ndarray]:
    """Return arrays (K, M, N, ...) in files, by name."""
    columns, rows = RESOLUTION
    kinds = {"rgba": ((4,), np.float32), "Z": ((), np.float32), "id": ((), np.uint32)}
    return {
        name: np.lib.format.open_memmap(folder / f"{name}.npy", "w+", kind, (views, rows, columns, *channels))
        for name, (channels, kind) in kinds.items()
    }


def address(library: str, array: np.ndarray) -> int:
    """Return where the tensor is that a library makes of an array by DLPack."""
    module: Any = importlib.import_module(library)
    if library == "torch":
        return module.from_dlpack(array.view(np.int32) if array.dtype == np.uint32 else array).data_ptr()
    if library == "jax":
        return module.numpy.from_dlpack(array).unsafe_buffer_pointer()
    return module.from_dlpack(array).ctypes.data


def report(library: str, arrays: dict[str, np.ndarray]) -> str:
    try:
        copied = [name for name, array in arrays.items() if address(library, array) != array.ctypes.data]
    except ImportError:
        return f"{library}: not installed"
    return f"{library}: {'copied ' + ', '.join(copied) if copied else 'shares the memory of ' + ', '.join(arrays)}"


def main() -> int:
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("--views", type=int, default=36, help="number of views (default: 36)")
    parser.add_argument("--out", default=".", help="folder (default: this one)")
    arguments = parser.parse_args()
    try:
        scene = clshade.builtin("icosphere")
        camera = scene.camera.with_resolution(RESOLUTION)
        numbers = clshade.farm.parse_frames(f"1..{arguments.views}")
        cameras = list(clshade.farm.orbit(camera, numbers.numbers, numbers).values())
        folder = create_folder(arguments.out)
        with clshade.Renderer(scene, layers=LAYERS) as renderer:
            files = mapped(folder, len(cameras))
            renderer.render_many(cameras, out=files)
            for array in files.values():
                array.flush()
            print(f"wrote {len(cameras)} views: {', '.join(f'{name}.npy' for name in files)}")
            views = renderer.render_many(cameras)
        for library in ("numpy", "torch", "jax"):
            print(report(library, views.arrays))
    except ClshadeError as error:
        print(f"tensors.py: {' '.join(str(error).split())}", file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    interrupts.run(main)
