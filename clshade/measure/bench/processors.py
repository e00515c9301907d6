"""`bench --processors`: what PyPI's PoCL makes of the kernels for other processors, and how fast that is on this one."""

from __future__ import annotations

import importlib.util
import json
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from itertools import pairwise
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple, TextIO

from ...base import atomic_files, console, text_tables
from ...base.text_tables import digits
from ...errors import ClshadeError, InputError
from ...pipeline import programs
from ...pipeline.opencl import pocl_target
from ..report.study import machine
from .children import ROOT, completed, run_module
from .tables import paths, show
from .workloads import pick


class Processor(NamedTuple):
    """A processor as PoCL sees it.

    target: its name in LLVM 14. library: of PoCL's functions, kernel-*-LIBRARY.bc. level, flags: what runs its code: the
    level of the x86-64 psABI, and what else /proc/cpuinfo has to name. about: what it stands for.
    """

    target: str
    library: str
    level: int
    flags: tuple[str, ...]
    about: str


_ICELAKE = ("gfni", "vaes", "avx512_vbmi2", "avx512_vnni")  # which LLVM uses for the newer processors
MODELS = {
    "nehalem": Processor("nehalem", "sse41", 2, (), "The oldest processors, without AVX and FMA."),
    "ivybridge": Processor("ivybridge", "avx_f16c", 2, ("avx", "f16c"), "AVX without FMA, Intel 2012."),
    "haswell": Processor("haswell", "avx2", 3, (), "AVX2 and FMA, Intel since 2013."),
    "skylake": Processor("skylake", "avx2", 3, (), "Intel's laptops and desktops, 2015 to 2021."),
    "alderlake": Processor("alderlake", "avx2", 3, ("gfni", "avx_vnni"), "Intel's laptops and desktops since 2021."),
    "zen1": Processor("znver1", "avx2", 3, (), "AMD EPYC 7001, Ryzen 1000."),
    "zen3": Processor("znver3", "avx2", 3, (), "AMD EPYC 7003, Ryzen 5000."),
    "zen4": Processor("znver3", "avx512", 3, (), "What LLVM 14 and PoCL make of AMD EPYC 9004 and Ryzen 7000."),
    "skylake-avx512": Processor("skylake-avx512", "avx512", 4, (), "Intel's servers of 2017."),
    "icelake-server": Processor("icelake-server", "avx512", 4, _ICELAKE, "Intel's servers of 2021."),
    "sapphirerapids": Processor("sapphirerapids", "avx512", 4, (*_ICELAKE, "avx512_bf16"), "Intel's servers of 2023."),
}
_VECTOR_BITS = {"sse41": "128", "avx512": ""}  # of llvmpipe, by library; others 256; "": its own choice

# Names of functions in compiled kernels: mangled ones of PoCL's library, and those of the C library.
_CALLED = re.compile(rb"_Z(\d+)(_cl_\w+)")
_FROM_C = re.compile(
    rb"\0((?:fma|fmin|fmax|sqrt|rint|floor|ceil|trunc|round|exp2?|log2?|pow|ldexp)f?|mem(?:cpy|set))\0"
)
_PROGRESS = ("clshade: trying out ", "clshade: compiling ")

COLUMNS = (
    *("model", "target", "lanes", "images", "warnings", "calls", "of C"),
    *("cold s", "warm s", "six cold s", "six warm s"),
)
NOTE = (
    "images: whether six small images have the bits that this processor's own kernels draw; warnings: of the compilers, and "
    "lines on standard error; calls: functions of PoCL's library that compiled kernels call; of C: functions of the C "
    "library; cold s, warm s: `python -m clshade render --samples 1` with an empty cache, and again; six: a process that "
    "draws the six images, or only compiles their kernels; ms: median of frames; llvmpipe: times as fast as it, with "
    "vectors of as many bits; all times are those of this processor"
)


@dataclass(frozen=True)
class Measured:
    """What was found of a model.

    ran: False if its kernels were only compiled: this processor lacks their instructions. wrong: names of images with
    other bits than this processor's own kernels draw. seconds: as of COLUMNS. frames: workload -> ms, and the ratio to
    llvmpipe, None without. failed: why the model's process ended, "" if it did not.
    """

    model: str
    ran: bool
    target: str = ""
    lanes: int | None = None
    warnings: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()
    of_c: tuple[str, ...] = ()
    wrong: tuple[str, ...] = ()
    seconds: dict[str, float] = field(default_factory=dict)
    frames: dict[str, tuple[float, float | None]] = field(default_factory=dict)
    failed: str = ""

    @property
    def passed(self) -> bool:
        return not (self.failed or self.wrong or self.warnings or self.calls)

    def row(self, workloads: Iterable[str]) -> text_tables.Row:
        images = "FAILED" if self.failed else ", ".join(self.wrong) or ("same" if self.ran else "not run here")
        of_c = " ".join(self.of_c) or "-"
        known = (self.model, self.target, digits(self.lanes), images, len(self.warnings), len(self.calls), of_c)
        times = [self.seconds.get(name) for name in COLUMNS[-4:]]
        times += [figure for name in workloads for figure in self.frames.get(name, (None, None))]
        return (*map(str, known), *map(digits, times))

    def faults(self) -> list[str]:
        """Return a line for each fault."""
        found = (self.failed, *self.warnings, *(f"calls {name}" for name in self.calls))
        return [f"{self.model}: {text}" for text in (*found, *(f"other bits: {name}" for name in self.wrong)) if text]


def _packages() -> Path:
    """Return the folder with PyPI's pyopencl and PoCL. Raises InputError where there is none."""
    spec = importlib.util.find_spec("pyopencl")
    folder = Path(spec.origin).parents[1] if spec is not None and spec.origin else Path()
    usable = sys.platform.startswith("linux") and platform.machine() == "x86_64"
    if not usable or not (folder / "pocl_binary_distribution").is_dir():
        raise InputError(
            "bench: --processors: expected Linux on x86-64 with PyPI's PoCL, `pip install 'pyopencl[pocl]'`"
        )
    return folder


def can_run(model: str) -> bool:
    """Return whether this processor has the instructions of the model's."""
    asked, flags = MODELS[model], pocl_target.processor_flags()
    return pocl_target.level_of(flags) >= asked.level and set(asked.flags) <= flags


def environment_of(model: str, folder: Path) -> dict[str, str]:
    """Return the environment variables with which a child process has the model's PoCL, and a cache of its own.

    The folder gets links to PyPI's packages, with the model's library under every name: PoCL looks for it beside the path
    by which it was loaded. Raises InputError without these packages.
    """
    source, packages, cache = _packages(), folder / "packages", folder / "cache"
    if not packages.exists():
        for name in ("pyopencl", "pocl_binary_distribution"):
            shutil.copytree(source / name, packages / name, copy_function=os.symlink)
        libraries = sorted(packages.glob("pocl_binary_distribution/.libs/share/pocl/kernel-*.bc"))
        chosen = next(path for path in libraries if path.stem.endswith(f"-{MODELS[model].library}")).resolve()
        for path in libraries:
            path.unlink()
            path.symlink_to(chosen)
        (packages / "no-vendors").mkdir()
    cache.mkdir(exist_ok=True)
    search = (str(packages), str(ROOT), os.environ.get("PYTHONPATH", ""))
    return {
        "PYTHONPATH": os.pathsep.join(filter(None, search)),
        "OCL_ICD_VENDORS": str(packages / "no-vendors"),
        "XDG_CACHE_HOME": str(cache),
        "POCL_CACHE_DIR": "",
        "CLSHADE_DEVICE": "pocl",
        "LP_NATIVE_VECTOR_WIDTH": _VECTOR_BITS.get(MODELS[model].library, "256"),
        pocl_target.FORCED: MODELS[model].target,
        programs.QUICK: "",
    }


def called_by_kernels(cache: Path) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return the names of functions that the compiled kernels below the folder call: of PoCL's library, of C's."""
    library, of_c = set(), set()
    for path in cache.rglob("*.so"):
        data = path.read_bytes()
        library |= {text[: int(length)].decode() for length, text in _CALLED.findall(data)}
        of_c |= {name.decode() for name in _FROM_C.findall(data)}
    return tuple(sorted(library)), tuple(sorted(of_c))


def own_images() -> dict[str, str]:
    """Return the digests of the six images as this processor's own PoCL draws them. Raises ChildError."""
    variables = {"CLSHADE_DEVICE": "pocl", pocl_target.FORCED: "", programs.QUICK: ""}
    images: dict[str, str] = _apart("draw", None, variables)["images"]
    return images


def _apart(task: str, folder: Path | None, variables: Mapping[str, str], *further: int) -> dict[str, Any]:
    said = run_module("clshade.measure.bench.processors_apart", task, *further, cwd=folder, **variables)
    found: dict[str, Any] = json.loads(said)
    return found


def draw_scenes(model: str, folder: Path, own: Mapping[str, str]) -> Measured:
    """Draw the six scenes with the model's PoCL and an empty cache in the folder, or only compile their kernels.

    own: name -> digest, of `own_images`. Of `seconds` it finds "six cold s". Raises InputError without PyPI's PoCL.
    """
    ran, variables = can_run(model), environment_of(model, folder)
    start = time.perf_counter()
    task = "draw" if ran else "compile"
    done = completed("clshade.measure.bench.processors_apart", task, cwd=folder, **variables)
    found = Measured(model, ran, seconds={"six cold s": time.perf_counter() - start})
    lines = [line for line in done.stderr.splitlines() if line.strip() and not line.startswith(_PROGRESS)]
    calls, of_c = called_by_kernels(Path(variables["XDG_CACHE_HOME"]))
    found = replace(found, calls=calls, of_c=of_c)
    if done.returncode:
        return replace(found, failed=(lines or [f"exit code {done.returncode}"])[-1])
    said: dict[str, Any] = json.loads(done.stdout)
    return replace(
        found,
        target=said["version"].rpartition("gnu-")[2],
        lanes=said["lanes"],
        warnings=(*said["warnings"], *lines),
        wrong=tuple(name for name, digest in said.get("images", {}).items() if own[name] != digest),
    )


def measure(model: str, folder: Path, frames: int, own: Mapping[str, str]) -> Measured:
    """Do what `draw_scenes` does, then measure starts, and frames of some workloads: so many of each."""
    found = draw_scenes(model, folder, own)
    if found.failed or not found.ran:
        return found
    variables = environment_of(model, folder)
    first = {**variables, "XDG_CACHE_HOME": str(folder / "first")}
    Path(first["XDG_CACHE_HOME"]).mkdir()
    times = [time.perf_counter()]
    try:
        _apart("draw", folder, variables)
        times.append(time.perf_counter())
        for _ in range(2):
            run_module("clshade", "render", "--samples", "1", "-o", "out", cwd=folder, **first)
            times.append(time.perf_counter())
        frame_ms = _apart("time", folder, variables, frames)
    except ClshadeError as error:
        return replace(found, failed=str(error))
    more = zip(("six warm s", "cold s", "warm s"), pairwise(times), strict=True)
    seconds = {**found.seconds, **{name: end - start for name, (start, end) in more}}
    return replace(found, seconds=seconds, frames={name: tuple(pair) for name, pair in frame_ms.items()})


def run(names: Sequence[str], *, frames: int, out: str | None = None, stream: TextIO | None = None) -> bool:
    """Measure the named models, by default all; print a table and write files. Returns True if none has a fault.

    frames: of each workload. Raises InputError, OutputError, ChildError if this processor's own PoCL does not draw.
    """
    chosen = pick(names, MODELS, "--processors")
    if frames < 1:
        raise InputError(f"bench: --frames: expected a whole number above 0, found {frames}")
    _packages()
    files = [] if out is None else paths(out)[:3]
    for path in files:
        atomic_files.check(path)
    own, found = own_images(), []
    for model in chosen:
        console.progress(f"{model}: {MODELS[model].about}")
        with TemporaryDirectory(prefix="clshade-processor-") as folder:
            found.append(measure(model, Path(folder), frames, own))
    _report(found, files, stream or sys.stdout)
    return all(each.passed for each in found)


def _report(found: Sequence[Measured], files: Sequence[Path], stream: TextIO) -> None:
    """Print the table, and write it into the files: CSV, JSON and Markdown, or none."""
    workloads = list(dict.fromkeys(name for each in found for name in each.frames))
    header = (*COLUMNS, *(title for name in workloads for title in (f"{name} ms", "llvmpipe")))
    rows = [each.row(workloads) for each in found]
    title, faults = f"{time.strftime('%Y-%m-%d')}, {machine()}", [fault for each in found for fault in each.faults()]
    stats = {"title": title, "models": [asdict(each) for each in found]}
    show(title, header, rows, NOTE, faults, stats, files, stream, left=2)
