"""Progress of a solve: a bar on a terminal, plain lines elsewhere."""

from __future__ import annotations

import math
import sys
from types import TracebackType
from typing import Any

from fenics_contact.analysis.capacity import CapacityPoint
from fenics_contact.analysis.coulomb import FixedPointStep


class Progress:
    """Shows the digits gained by the fixed point.

    On a terminal a bar fills as the change of the friction bound falls from 1 to the tolerance;
    elsewhere every iteration is a line.
    """

    def __init__(self, enabled: bool, bar: bool, tolerance: float) -> None:
        """Say whether to show anything, whether as a bar, and how far there is to go."""
        self._enabled = enabled
        self._as_bar = bar
        self._digits = -math.log10(tolerance)
        self._bar: Any = None
        self._name = ""
        self._count = 0

    def __enter__(self) -> Progress:
        """Start; the bar appears with the first step."""
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Leave the terminal clean."""
        self._close()

    def step(self, direction: str, step: FixedPointStep) -> None:
        """Show one fixed-point iteration."""
        self._count = self._count + 1 if direction == self._name else 1
        gained = self._digits
        if step.change > 0.0:
            gained = min(max(-math.log10(step.change), 0.0), self._digits)
        self._show(
            direction,
            (gained, self._digits),
            f"iteration {self._count:3d}  load factor {step.load_factor:.8g}"
            f"  change of friction {step.change:.1e}  factorisations {step.steps}",
        )

    def point(self, done: int, total: int, point: CapacityPoint) -> None:
        """Show one point of the capacity curve."""
        self._show("capacity", (done, total), f"{done} of {total}  {point.load_factor:.6g}")

    def _show(self, name: str, gained: tuple[float, float], text: str) -> None:
        if not self._enabled:
            return
        if name != self._name:
            self._close()
            self._name = name
        if not self._as_bar:
            sys.stdout.write(f"{name}: {text}\n")
            sys.stdout.flush()
            return
        from tqdm import tqdm

        if self._bar is None:
            form = "{desc}: {percentage:3.0f}%|{bar:20}| {postfix}"
            self._bar = tqdm(total=round(gained[1], 2), desc=name, bar_format=form, file=sys.stdout)
        self._bar.n = max(self._bar.n, round(gained[0], 2))
        self._bar.set_postfix_str(text)

    def _close(self) -> None:
        if self._bar is not None:
            self._bar.close()
            self._bar = None
