"""Which picture to draw next: a coarse one while the view moves, then more and more samples once it is still."""

from __future__ import annotations

import math
from dataclasses import dataclass

SAMPLES = (1, 4, 16, 64)
SCALES = (1, 2, 4)  # pixels of a full picture per pixel of a coarse one, across and down
FRAME_MS = 33.0  # of a picture while the view moves: 30 frames/s
LARGE = 1_000_000  # triangles: larger scenes get no renderers for the steps in between


@dataclass(frozen=True)
class Step:
    """A picture: its samples per pixel, and how much coarser it is in both directions. last: nothing follows it."""

    samples: int
    scale: int = 1
    last: bool = False


class Refinement:
    """The steps of a view, from the latest change on, and the time that a kind of picture took.

    A step begins only when the view has been still for as long as the step is expected to take: an input never waits
    much longer than it already did.
    """

    def __init__(self) -> None:
        self._ms: dict[tuple[int, int], float] = {}  # (samples, scale) -> time of the latest picture
        self._steps: list[Step] = []
        self._changed, self.is_first = 0.0, False  # whether no picture of the view was drawn yet

    def restart(self, samples: int, triangles: int, now: float) -> None:
        """Begin again, for a view that changed at the time `now`, s, and is to end with so many samples."""
        scale = self._coarse_scale()
        between = [count for count in SAMPLES if 1 < count < samples and triangles <= LARGE]
        steps = [Step(1, scale), *([Step(1)] if scale > 1 else []), *map(Step, between)]
        self._steps = [*steps, Step(samples, last=True)]
        self._changed, self.is_first = now, True

    def due(self, now: float) -> Step | float | None:
        """Return the next step, or the seconds until it is due, or None if all are drawn."""
        if not self._steps:
            return None
        step = self._steps[0]
        if self.is_first:
            return step
        wait = self._changed + self._expected_ms(step) / 1e3 - now
        return step if wait <= 0.0 else wait

    def drawn(self, step: Step, ms: float, *, current: bool) -> None:
        """Note a step's time. current: whether it shows this view, not an earlier one."""
        key = step.samples, step.scale
        self._ms[key] = ms if key not in self._ms else 0.5 * (self._ms[key] + ms)
        if current and self._steps and self._steps[0] == step:
            del self._steps[0]
            self.is_first = False

    def _expected_ms(self, step: Step) -> float:
        """Return a step's expected time: that of earlier such pictures, or one from pictures with fewer samples."""
        measured = [(count, ms) for (count, scale), ms in self._ms.items() if scale == 1 and count <= step.samples]
        count, ms = max(measured, default=(1, 0.0))
        return ms * math.sqrt(step.samples / count)  # as a rule: edges alone have samples to light

    def _coarse_scale(self) -> int:
        """Return the finest scale whose pictures come fast enough, else the one beyond which nothing is gained."""
        coarsest = SCALES[-1]
        expected = {coarsest: self._ms.get((1, coarsest), 0.0)}
        for scale in reversed(SCALES[:-1]):
            # At most in proportion to the pixels: what a scale took once, on a busy machine, does not hold forever.
            by_pixels = 4.0 * expected[2 * scale] if expected[2 * scale] else math.inf
            expected[scale] = min(self._ms.get((1, scale), math.inf), by_pixels)
        expected = {scale: ms for scale, ms in expected.items() if 0.0 < ms < math.inf}
        fast = [scale for scale in SCALES if expected.get(scale, math.inf) <= FRAME_MS]
        if fast or not expected:
            return min(fast, default=1)
        coarser = SCALES[min(SCALES.index(max(expected)) + 1, len(SCALES) - 1)]  # the first without a time
        fastest = min(expected.values())
        return coarser if coarser not in expected else min(s for s, ms in expected.items() if ms <= 1.5 * fastest)
