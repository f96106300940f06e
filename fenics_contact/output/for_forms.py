"""What forms of the user need of a result: its stresses in UFL, and measures that know groups."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Any

from fenics_contact.discretization.forms import GroupMeasure, measures, stress_of
from fenics_contact.discretization.layout import Layout
from fenics_contact.geometry.mesh import Array
from fenics_contact.output.fields import displacement_function


class ForForms(ABC):
    """A result whose fields can be integrated and interpolated, on `scene.mesh.domain`."""

    layout: Layout

    @abstractmethod
    def _elastic(self) -> Array | None:
        """Displacements that strain the blocks, in the supports' coordinates; None without any."""

    @property
    def stress(self) -> Any | None:
        """Stress in the plane, Pa, a UFL tensor; None if there is no state. Collective.

        It is that of the scene's plane state or stress law, of the part of the displacements that
        strains the blocks: beside a large motion the sum has fewer digits.
        """
        values = self._elastic()
        if values is None:
            return None
        layout = self.layout
        return stress_of(displacement_function(layout, values, "elastic"), layout.law)

    def measures(self) -> tuple[GroupMeasure, GroupMeasure]:
        """UFL's dx over the blocks and ds over their edges, both faces of joints among these.

        They take names of groups: `dx("stone")`, `ds(("back", "top"))`.
        """
        return measures(self.layout.scene.mesh, self.layout.boundary)
