"""Mutation testing: plant small faults in kernels, loaders and measurements, one at a time; report which tests detect.

    python tests/mutants.py --count 200                      # draws with a random seed, which it prints
    python tests/mutants.py --count 200 --seed 7 -o run.jsonl   # resumes an interrupted run
    python tests/mutants.py --list clshade/scene/formats/obj.py              # every possible change
    python tests/mutants.py --only kernels/fill.clh --count 20 --seed 7

Every line that can be changed is equally likely to be drawn, and at least two lines of each file are. A mutant is
written into a copy of the repository in a temporary folder, with a kernel cache of its own, and the tests of its
file run there, cheapest first, until one fails; then, of kernels and loaders, those of the whole subject. A mutant
that does not build is drawn again. Mutants are `found` if a test fails, hangs beyond its time or crashes, and
`equivalent` if no test can detect them, for the reasons in mutants_equivalent.json: by file, by the line before and
after the change ("*" for any), if necessary by the line above, with runs of blanks as one; for these only the tests
of the file are run. The others `survived`. Exit code 0: at least 95 % of all were found and none survived.

Not collected by pytest: 200 mutants take an hour or more of one core. CLSHADE_TEST_PLATFORM limits the devices.
"""

from __future__ import annotations

import argparse
import difflib
import hashlib
import json
import os
import random
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from mutation_sites import Site, sites

ROOT = Path(__file__).resolve().parent.parent
EQUIVALENT = Path(__file__).with_name("mutants_equivalent.json")
LEAST = 2  # mutants per file
WANTED = 0.95  # fraction that must be found
LIMITS = {"kernels": 1800.0, "clshade": 300.0}  # seconds per group of tests, by the file's folder

# The tests of each file, cheapest first: test_*.py anywhere under tests.
TESTS = {
    "kernels/attributes.clh": "kernel_layers kernel_pixels light_bounds frames",
    "kernels/batch.clh": "kernel_pixels light_bounds frames sampling",
    "kernels/bilerp.cl": "kernel_bilerp course_light",
    "kernels/bin.cl": "kernel_bin",
    "kernels/corners.clh": "kernel_setup kernel_fill",
    "kernels/edge.clh": "kernel_setup kernel_bin kernel_fill kernel_pixels",
    "kernels/fill.clh": "kernel_fill same_bits materials sampling",
    "kernels/gouraud.cl": "kernel_pixels frames",
    "kernels/lanes.clh": "kernel_lanes kernel_numerics kernel_light kernel_fill",
    "kernels/layers.cl": "kernel_layers kernel_instances",
    "kernels/layer_blocks.clh": "kernel_layers layers",
    "kernels/lines.cl": "kernel_lines lines",
    "kernels/light.cl": "kernel_light course_light",
    "kernels/blend.clh": "transparency every_feature",
    "kernels/fragment_order.clh": "transparency every_feature",
    "kernels/operations.clh": "kernel_operations",
    "kernels/peel.clh": "transparency every_feature",
    "kernels/microfacet.clh": "kernel_pbr maps",
    "kernels/environment.clh": "image_light",
    "kernels/backdrop.clh": "kernel_backdrop background",
    "kernels/light.clh": "kernel_light kernel_pixels lit_floor",
    "kernels/phong_terms.clh": "kernel_light kernel_pixels",
    "kernels/maps.clh": "maps kernel_maps",
    "kernels/lookups.clh": "maps trilinear materials",
    "kernels/numerics.clh": "kernel_numerics kernel_light",
    "kernels/output.clh": "kernel_fill kernel_pixels nonfinite",
    "kernels/ownership.clh": "kernel_fill materials sampling transparency alpha_modes",
    "kernels/phong.cl": "kernel_pixels frames kernel_pbr maps",
    "kernels/project.cl": "kernel_project kernel_instances",
    "kernels/projection.clh": "kernel_project instances",
    "kernels/placements.clh": "kernel_instances instances",
    "kernels/resolve.clh": "sampling lines",
    "kernels/rows.clh": "kernel_bilerp kernel_pixels",
    "kernels/samples.clh": "kernel_bin kernel_fill sampling",
    "kernels/pair_vectors.clh": "kernel_shadow hierarchy",
    "kernels/shadow_predicate.clh": "kernel_shadow hierarchy",
    "kernels/hierarchy.cl": "hierarchy",
    "kernels/hierarchy.clh": "hierarchy",
    "kernels/shadow_packets.clh": "hierarchy shadow_fans",
    "kernels/shadow_fans.clh": "shadow_fans",
    "kernels/single_rays.clh": "shadow_fans",
    "kernels/shadow_traversal.clh": "hierarchy shadow_fans",
    "kernels/shadow.cl": "kernel_shadow hierarchy",
    "kernels/shadow_receiver.clh": "shadows every_feature",
    "kernels/ambient_occlusion.clh": "ambient_occlusion every_feature",
    "kernels/shadow_veils.clh": "shadows every_feature",
    "kernels/light_kinds.clh": "kernel_light lit_floor",
    "kernels/light_points.clh": "lit_floor every_feature",
    "kernels/light_shadows.clh": "lit_floor shadows every_feature",
    "kernels/setup.cl": "kernel_setup kernel_instances",
    "kernels/surface.clh": "kernel_pixels kernel_fill nonfinite materials",
    "kernels/surface_layers.cl": "layers every_feature",
    "kernels/texture.clh": "kernel_bilerp materials trilinear",
    "kernels/triangle_lanes.clh": "kernel_fill kernel_pixels",
    "kernels/triangle_table.clh": "kernel_pixels light_bounds frames",
    "kernels/tile_walk.clh": "kernel_bin kernel_setup",
    "kernels/tile.clh": "kernel_fill kernel_pixels",
    "clshade/scene/formats/text_tokens.py": "obj",
    "clshade/scene/formats/obj.py": "mtl obj loading limits",
    "clshade/scene/formats/mtl.py": "mtl obj limits",
    "clshade/scene/formats/ply.py": "ply_stl limits",
    "clshade/scene/formats/stl.py": "ply_stl limits",
    "clshade/scene/formats/gltf.py": "gltf gltf_refusals gltf_animations play playing",
    "clshade/scene/formats/gltf_data.py": "gltf gltf_refusals limits",
    "clshade/scene/formats/gltf_meshes.py": "gltf gltf_refusals gltf_skins limits",
    "clshade/scene/formats/gltf_nodes.py": "gltf gltf_refusals gltf_skins gltf_animations gltf_lights limits",
    "clshade/scene/pose.py": "play playing",
    "clshade/scene/formats/gltf_materials.py": "gltf gltf_maps alpha_modes gltf_refusals",
    "clshade/scene/formats/scene_json.py": "scene_json limits",
    "clshade/scene/formats/course_npy.py": "course_files course_refusals limits",
    "clshade/scene/formats/safe_pickle.py": "course_files inert_pickle limits",
    "clshade/scene/triangulate.py": "triangulation obj gltf ply_stl",
    "clshade/scene/formats/load.py": "loading course_files",
    "clshade/images/decode.py": "images deep_images limits",
    "clshade/measure/grade/reading.py": "grade_files grade",
    "clshade/measure/verify/confidence.py": "confidence",
    "clshade/measure/verify/recorded_image.py": "verify",
    "clshade/pipeline/frame_results.py": "verify",
    "clshade/scene/description.py": "description verify",
}
# Then these, for kernels and for loaders, one group at a time.
KERNELS = (
    "every_feature same_bits frames kernel_fill kernel_pixels",
    "kernel_layers kernel_bin kernel_setup kernel_pixels kernel_light kernel_numerics kernel_project kernel_bilerp layers",
    "materials sampling precision course_triangle nonfinite projection trilinear",
)
LOADERS = (
    "limits loading obj mtl ply_stl gltf gltf_refusals course_files course_refusals images deep_images",
    "creases mesh_peer course_textures mesh_pictures bad_files cli_meshes refusals fuzz",
)
# Other numbers of lanes are tested with -m long.
LANES = {"kernels/lanes.clh", "kernels/rows.clh"}
WITH_LANES = [
    "-m",
    "long or not long",
    "-k",
    "lanes",
    *(f"tests/test_kernel_{n}.py" for n in ("bilerp", "fill", "phong")),
    "tests/pipeline/test_same_bits.py",
]

Record = dict[str, Any]


@dataclass(frozen=True)
class Mutant:
    """A change of a file: the line before and after."""

    file: str
    site: Site
    line: int
    before: str
    after: str

    @property
    def key(self) -> str:
        return hashlib.sha256(f"{self.file} {self.site}".encode()).hexdigest()[:12]


def mutants_of(file: str) -> list[Mutant]:
    text = (ROOT / file).read_text()
    return [Mutant(file, site, *site.lines(text)) for site in sites(file, text)]


def draw(count: int, seed: int, files: list[str]) -> dict[str, tuple[int, list[Mutant]]]:
    """Return for each file the number wanted, and all its mutants in the order in which they are tried."""
    drawn, lines = {}, {}
    for file in files:
        rng = random.Random(f"{seed} {file}")
        by_line: dict[int, list[Mutant]] = {}
        for mutant in mutants_of(file):
            by_line.setdefault(mutant.line, []).append(mutant)
        for of_line in by_line.values():
            rng.shuffle(of_line)
        order = []
        while by_line:  # one of each line, in random order, then a second one of each line, ...
            keys = rng.sample(sorted(by_line), len(by_line))
            order += [by_line[key].pop() for key in keys]
            lines.setdefault(file, len(keys))
            by_line = {key: of_line for key, of_line in by_line.items() if of_line}
        drawn[file] = order
    wanted = {file: min(LEAST, len(drawn[file])) for file in files}
    while sum(wanted.values()) < min(count, sum(map(len, drawn.values()))):
        open_ones = [file for file in files if wanted[file] < len(drawn[file])]
        wanted[max(open_ones, key=lambda file: lines[file] / wanted[file])] += 1
    return {file: (wanted[file], drawn[file]) for file in files}


# Running tests


class Copy:
    """A copy of the repository in which one mutant at a time is tried."""

    def __init__(self, folder: Path, quick: bool) -> None:
        self.folder = folder / "copy"
        ignored = shutil.ignore_patterns(".git", ".*_cache", "__pycache__", "*.egg-info", ".venv*", "*.exr")
        shutil.copytree(ROOT, self.folder, ignore=ignored)
        self.environment = {**os.environ, "PYTHONPATH": str(self.folder), "XDG_CACHE_HOME": str(folder / "cache")}
        self.environment |= {"PYTHONDONTWRITEBYTECODE": "1", "HYPOTHESIS_STORAGE_DIRECTORY": str(folder / "examples")}
        (folder / "cache").mkdir()
        self.quick, self.table = quick, json.loads(EQUIVALENT.read_text())
        self._passed: set[tuple[str, ...]] = set()
        self._process: subprocess.Popen[str] | None = None
        self._stopped = False

    def pytest(self, arguments: list[str], limit: float) -> tuple[int | None, str]:
        """Run pytest; return the exit code, None after `limit` seconds, and the output."""
        command = [
            "nice",
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-q",
            "--tb=short",
            "-p",
            "no:cacheprovider",
            *arguments,
        ]
        if self._stopped:
            raise KeyboardInterrupt
        process = self._process = subprocess.Popen(
            command,
            cwd=self.folder,
            env=self.environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            start_new_session=True,
        )
        try:
            text, _ = process.communicate(timeout=limit)
        except subprocess.TimeoutExpired:
            return None, ""
        finally:
            if process.returncode is None:
                os.killpg(process.pid, signal.SIGKILL)
                process.wait()
        if self._stopped:
            raise KeyboardInterrupt
        return process.returncode, text

    def stop(self) -> None:
        """Kill the running tests, and run no others."""
        self._stopped = True
        if self._process is not None and self._process.returncode is None:
            os.killpg(self._process.pid, signal.SIGKILL)

    def passes(self, arguments: list[str], limit: float) -> None:
        """Abort the run if the tests that detect a mutant do not pass without one."""
        if tuple(arguments) in self._passed:
            return
        code, text = self.pytest(arguments, limit)
        if code != 0:
            raise SystemExit(f"without a mutant: pytest {' '.join(arguments)} ends with {code}\n{text[-3000:]}")
        self._passed.add(tuple(arguments))

    def try_one(self, mutant: Mutant) -> Record:
        path = self.folder / mutant.file
        text = path.read_text()
        changed = mutant.site.applied(text)
        start, outcome, by = time.monotonic(), "survived", ""
        groups = test_groups(mutant.file)
        place = {"file": mutant.file, "line": mutant.line}
        equivalence = reason({**place, "from": mutant.before, "to": mutant.after}, self.table)
        limit = LIMITS[mutant.file.split("/")[0]]
        for group in groups[:1] if equivalence or self.quick else groups:
            path.write_text(changed)
            try:
                code, printed = self.pytest(group, limit)
            finally:
                path.write_text(text)
            outcome, by = judged(code, printed)
            if outcome in ("found", "timeout"):
                self.passes([by, "-m", "long or not long"] if by.startswith("tests/") else group, limit)
            if outcome != "survived":
                break
        diff = list(difflib.unified_diff(text.splitlines(), changed.splitlines(), lineterm="", n=0))[3:]
        return {
            "key": mutant.key,
            "file": mutant.file,
            "line": mutant.line,
            "kind": mutant.site.kind,
            "from": mutant.before,
            "to": mutant.after,
            "outcome": outcome,
            "by": by,
            "seconds": round(time.monotonic() - start, 1),
            "diff": diff,
        }


def test_file(name: str) -> str:
    """Return the path of the only tests/.../test_NAME.py."""
    (path,) = (ROOT / "tests").rglob(f"test_{name}.py")
    return path.relative_to(ROOT).as_posix()


def test_groups(file: str) -> list[list[str]]:
    """Return the arguments of pytest by group: each group runs if the previous ones detect nothing."""
    loads = file.startswith(("clshade/scene/", "clshade/images/"))
    named = [TESTS[file], *(KERNELS if file.startswith("kernels/") else LOADERS if loads else ())]
    seen: set[str] = set()
    groups = []
    for names in named:
        new = [name for name in names.split() if name not in seen]
        seen |= set(new)
        groups.append([test_file(name) for name in new])
    return [*groups[:1], *([WITH_LANES] if file in LANES else []), *groups[1:]]


def judged(code: int | None, printed: str) -> tuple[str, str]:
    """Return the outcome, and the test that led to it."""
    if code is None:
        return "timeout", "beyond its time"
    if code == 0:
        return "survived", ""
    if "the kernels did not build" in printed:
        return "broken", ""
    if code < 0:
        return "found", f"crash, signal {-code}"
    first = re.search(r"^(?:FAILED|ERROR) (\S+?(?:\[.*?\])?)(?: - .*)?$", printed, re.MULTILINE)
    return "found", first[1] if first else f"pytest's exit code {code}"


# The run


def reason(record: Record, table: list[dict[str, str]]) -> str | None:
    """Return why no test can detect a mutant, if known."""
    for entry in table:
        same = (entry["file"], entry["from"]) == (record["file"], record["from"]) and entry["to"] in ("*", record["to"])
        if same and entry.get("above", "") in ("", line_above(record["file"], record["line"])):
            return entry["reason"]
    return None


def line_above(file: str, line: int) -> str:
    """Return the line above a mutant's, with runs of blanks as one."""
    lines = (ROOT / file).read_text().splitlines()
    return " ".join(lines[line - 2].split()) if line > 1 else ""


def run(plan: dict[str, tuple[int, list[Mutant]]], out: Path, jobs: int, quick: bool, say: Any) -> list[Record]:
    """Try the drawn mutants; append each outcome as a line to `out`, and skip those already there."""
    lines = out.read_text().splitlines() if out.exists() else []
    done = {record["key"]: record for record in map(json.loads, lines)}
    lock, copies = threading.Lock(), []
    results: list[Record] = []

    def of_file(file: str) -> None:
        wanted, order = plan[file]
        for mutant in order:
            if wanted == 0:
                return
            record = done.get(mutant.key)
            if record is None:
                with lock:
                    copy = copies.pop()
                record = copy.try_one(mutant)
                with lock:
                    copies.append(copy)
                    with out.open("a") as file_out:
                        file_out.write(json.dumps(record) + "\n")
                say(f"{record['outcome']:9} {record['seconds']:6.0f} s  {file}:{mutant.line}  {record['by']}")
                if record["outcome"] != "found":
                    say("\n".join(record["diff"]))
            wanted -= record["outcome"] != "broken"
            with lock:
                results.append(record)

    with tempfile.TemporaryDirectory(prefix="mutants-") as folder:
        for job in range(jobs):
            (Path(folder) / str(job)).mkdir()
            copies.append(Copy(Path(folder) / str(job), quick))
        every = tuple(copies)
        with ThreadPoolExecutor(jobs) as pool:
            try:
                for waiting in [pool.submit(of_file, file) for file in plan]:
                    waiting.result()
            except BaseException:
                pool.shutdown(wait=False, cancel_futures=True)
                for copy in every:
                    copy.stop()
                raise
    return results


def summary(records: list[Record]) -> tuple[str, bool]:
    """Return a summary, and whether enough was found."""
    table = json.loads(EQUIVALENT.read_text())
    tried = [record for record in records if record["outcome"] != "broken"]
    left = [record for record in tried if record["outcome"] == "survived"]
    argued = [record for record in left if reason(record, table)]
    killed, hung = len(tried) - len(left), sum(record["outcome"] == "timeout" for record in tried)
    share = killed / max(len(tried), 1)
    lines = [
        f"{len(tried)} mutants, {len(records) - len(tried)} more did not build",
        f"found {killed} ({share:.1%}), {hung} by time",
    ]
    lines += [f"equivalent {len(argued)}, survived {len(left) - len(argued)}"]
    for record in left:
        lines += [f"{record['file']}:{record['line']}: {reason(record, table) or 'SURVIVED'}", *record["diff"][-2:]]
    return "\n".join(lines), share >= WANTED and len(argued) == len(left)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--count", type=int, default=200, help="mutants to try (200)")
    parser.add_argument("--seed", type=int, help="of the draw; by default any")
    parser.add_argument("--only", nargs="+", metavar="FILE", help="files to draw from")
    parser.add_argument("--list", metavar="FILE", help="print all mutants of a file and end")
    parser.add_argument("--quick", action="store_true", help="no other tests than those of the mutant's file")
    parser.add_argument("--jobs", type=int, default=1, help="mutants tried at the same time (1)")
    parser.add_argument("-o", "--out", type=Path, help="JSON lines, those of earlier runs too (mutants-SEED.jsonl)")
    options = parser.parse_args()
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    if options.list:
        for mutant in mutants_of(options.list):
            print(f"{mutant.line} {mutant.site.kind}\n- {mutant.before}\n+ {mutant.after}")
        return 0
    seed = random.SystemRandom().randrange(1 << 31) if options.seed is None else options.seed
    out = options.out or Path(tempfile.gettempdir(), f"mutants-{seed}.jsonl")
    print(f"seed {seed}, {out}", flush=True)
    plan = draw(options.count, seed, options.only or list(TESTS))
    records = run(plan, out, options.jobs, options.quick, lambda text: print(text, flush=True))
    text, good = summary(records)
    print(f"seed {seed}: {text}")
    return 0 if good else 1


if __name__ == "__main__":
    sys.exit(main())
