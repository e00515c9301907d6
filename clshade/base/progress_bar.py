"""Progress bars on standard error, whose estimates leave out compiling and whatever else is done once."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

from . import interrupts

_COUNT = "{desc}: {percentage:3.0f}%|{bar}| {n_fmt}/{total_fmt} "


class Bar:
    """A bar that counts items, for a `with` block. The first item does not count in the estimate: it waits for whatever is
    done once.

    what: that is counted. clock: seconds, without those that the estimate leaves out; None: there is no estimate. done:
    items that existed before. hidden: None: where standard error is no terminal. left: whether the bar stays at the end.
    began: the time, see `time.time`, since when the elapsed time is shown; None: now.
    """

    def __init__(
        self,
        total: int,
        what: str = "",
        *,
        clock: Callable[[], float] | None,
        done: int = 0,
        hidden: bool | None = None,
        left: bool = False,
        began: float | None = None,
    ) -> None:
        from tqdm import tqdm

        layout = _COUNT + ("[{elapsed}{postfix}]" if clock is None else "[{elapsed}<{remaining}{postfix}]")
        self._bar: Any = tqdm(
            total=total, desc=what, initial=done, smoothing=0.1, bar_format=layout, disable=hidden, leave=left
        )
        self._clock = clock or time.time
        self._times = time.time(), self._clock()
        self._is_first = True
        if began is not None:
            self._bar.start_t = began
        if not self._bar.disable:
            interrupts.open_lines.add(self)

    def advance(self, postfix: str = "") -> None:
        """Count an item that took the time since the last one. postfix: a text behind the times."""
        if self._bar.disable:
            return
        (wall, clock), self._times = self._times, (time.time(), self._clock())
        passed, worked = self._times[0] - wall, self._times[1] - clock
        self._bar.set_postfix_str(postfix, refresh=False)
        self._bar.last_print_t += passed if self._is_first else passed - worked  # as if it had not passed
        if self._is_first:
            self._is_first = False
            for counter in ("n", "initial", "last_print_n"):
                setattr(self._bar, counter, getattr(self._bar, counter) + 1)
            self._bar.refresh()
        else:
            self._bar.update()

    def clear(self) -> None:
        """Remove the bar until it is next drawn."""
        self._bar.clear()

    def close(self) -> None:
        self._bar.close()
        interrupts.open_lines.discard(self)

    def __enter__(self) -> Bar:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
