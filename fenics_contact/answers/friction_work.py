"""The work that friction takes up in the collapse, by group of joints.

The live load does work 1 on the mode v. Friction takes up, at every joint point, the shear force
times the slip: |r_T| |B_T v|. Summed up by group and divided by the sum it says which joints the
collapse load hangs on; with given friction bounds it says the same of these.
"""

from __future__ import annotations

from typing import Any, Self

import numpy as np

from fenics_contact.answers.question import Asked, MeshQuestion
from fenics_contact.results.result import Collapse
from fenics_contact.results.wording import Line, Wording

#: Parts below this are in result.json only.
SMALL = 1e-3


class FrictionWork(Asked):
    """Parts of the friction's work by name of the group, the largest first; their sum is 1."""

    value: dict[str, float]
    name = key = "friction_work"
    place = 8
    with_fast = True

    @classmethod
    def run(cls, question: MeshQuestion) -> tuple[Self | None, Collapse]:
        """The parts; None where nothing slides."""
        joints = question.case.discretization.joints.without_ties()
        values = question.end.joints
        if values is None:
            return None, question.end
        count = joints.joint_count
        work = np.abs(values.shear_force * values.slip_rate)[:count]
        of_group = np.bincount(joints.law, work, len(joints.names))
        if of_group.sum() <= 0.0:
            return None, question.end
        part = of_group / of_group.sum()
        order = np.argsort(-part, kind="stable")
        return cls({joints.names[k]: float(part[k]) for k in order if part[k] > 0.0}), question.end

    def record(self) -> Any:
        """The parts."""
        return dict(self.value)

    def lines(self, end: Collapse, words: Wording) -> list[Line]:
        """The parts of all groups that are not small, where there are several."""
        parts = [(name, part) for name, part in self.value.items() if part >= SMALL]
        told = ", ".join(f"{name} {100.0 * part:.3g} %" for name, part in parts)
        return [Line("work of friction:", told, verbose=True)] if len(parts) > 1 else []
