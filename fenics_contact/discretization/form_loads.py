"""Loads that are UFL forms of the user, f . v = L(v): measures with names of groups, and checks.

A form is refused where it would be a wrong load that looks right: on another mesh, over numbers
that are not groups of the scene, or not linear in the test function.
"""

from __future__ import annotations

from collections.abc import Mapping
from contextlib import nullcontext
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import ufl
from dolfinx import fem
from dolfinx import mesh as dolfinx_mesh
from ufl.algorithms import compute_form_data
from ufl.algorithms.check_arities import ArityMismatch
from ufl.constantvalue import Zero
from ufl.corealg.traversal import traverse_unique_terminals
from ufl.domain import extract_domains

from fenics_contact import compat
from fenics_contact.discretization.facets import Boundary
from fenics_contact.errors import InputError, raised_together
from fenics_contact.geometry.mesh import BlockMesh, Labels, Names
from fenics_contact.scene.scene import LoadForm


@dataclass(frozen=True)
class Groups:
    """Groups that a measure knows by name.

    Attributes:
        measure: "dx" or "ds".
        sets: Sets of group names; the measure's numbers are indices into them.
        names: All names.
        interior: Number of facets inside blocks, by name.
    """

    measure: str
    sets: tuple[Names, ...]
    names: tuple[str, ...]
    interior: Mapping[str, int]

    def numbers(self, name: Any) -> set[int]:
        """The measure's numbers of a group.

        Raises:
            InputError: If there is no such group, or facets of it are inside blocks.
        """
        place = f"{self.measure}({name!r})"
        if name not in self.names:
            known = ", ".join(map(repr, self.names)) or "none"
            raise InputError(f"{place} is over no group; give one of the names {known}")
        if name in self.interior:
            count = self.interior[name]
            raise InputError(f"{place}: {count} facets of the group lie inside a block, not at one")
        return {number for number, names in enumerate(self.sets) if name in names}


class GroupMeasure(ufl.Measure):
    """A measure over the blocks; `measure("back")` and `measure(("back", "top"))` are over groups.

    Attributes:
        groups: The groups.
    """

    def __init__(self, plain: ufl.Measure, groups: Groups) -> None:
        """A measure of UFL, with names."""
        super().__init__(
            plain.integral_type(),
            plain.ufl_domain(),
            plain.subdomain_id(),
            plain.metadata(),
            plain.subdomain_data(),
        )
        self.groups = groups

    def __call__(self, subdomain_id: Any = None, *more: Any, **options: Any) -> GroupMeasure:
        """The measure over a group or several, or with other options of UFL."""
        if isinstance(subdomain_id, (str, int, tuple)):
            names = subdomain_id if isinstance(subdomain_id, tuple) else (subdomain_id,)
            none = len(self.groups.sets)  # a number that no cell or facet has
            found = sorted(set().union(*map(self.groups.numbers, names))) or [none]
            subdomain_id = tuple(found)
        return super().__call__(subdomain_id, *more, **options)  # type: ignore[no-any-return]

    def reconstruct(self, *changes: Any, **options: Any) -> GroupMeasure:
        """UFL asks for a measure with changes here."""
        return GroupMeasure(super().reconstruct(*changes, **options), self.groups)


def measures(mesh: BlockMesh, boundary: Boundary) -> tuple[GroupMeasure, GroupMeasure]:
    """Dx over the blocks and ds over their edges, joints among these, with names of groups."""
    domain = mesh.domain
    cells = np.arange(len(mesh.cell_groups), dtype=np.int32)
    order = np.argsort(boundary.local_facets)
    groups = boundary.groups[boundary.local][order]
    facets = boundary.local_facets[order][groups >= 0]

    def measure(kind: str, dim: int, entities: Labels, numbers: Labels, groups: Groups) -> Any:
        tags = dolfinx_mesh.meshtags(domain, dim, entities, numbers)
        return GroupMeasure(ufl.Measure(kind, domain=domain, subdomain_data=tags), groups)

    of_cells = Groups("dx", mesh.cell_sets, mesh.cell_names, {})
    of_facets = Groups("ds", mesh.facet_sets, mesh.facet_names, boundary.interior)
    dx = measure("dx", 2, cells, mesh.cell_groups, of_cells)
    return dx, measure("ds", 1, facets, groups[groups >= 0], of_facets)


def given_load(
    mesh: BlockMesh, space: Any, boundary: Boundary, give: LoadForm, key: str
) -> fem.Form | None:
    """Compiled form of a load; None if it is zero. Collective.

    Raises:
        InputError: On all ranks, if the function fails, or its form is no load of these blocks;
            `key` names the load.
    """
    form: Any = None
    with raised_together(mesh.comm):
        v = ufl.TestFunction(space)
        dx, ds = measures(mesh, boundary)
        try:
            form = give(v, dx, ds)
        except Exception as error:  # of a function of the user
            raise InputError(f"{key}: {_told(error)}") from error
        form = _checked(form, v, (dx, ds), key)
    if form.empty():
        return None
    # dolfinx compiles on rank 0, while the others wait.
    cache = compat.form_cache() if mesh.comm.rank == 0 else nullcontext()
    try:
        with compat.quiet_compiler(), cache:
            return fem.form(form)
    except RuntimeError as error:
        raise InputError(f"{key}: the form cannot be compiled: {error}") from error


def _told(error: Exception) -> str:
    """An error with the line of the user's function that it came from."""
    trace = error.__traceback__ and error.__traceback__.tb_next
    if isinstance(error, InputError) or trace is None:
        return str(error)
    file = Path(trace.tb_frame.f_code.co_filename).name
    return f"{type(error).__name__} in line {trace.tb_lineno} of {file}: {error}"


def _checked(form: Any, v: Any, known: tuple[ufl.Measure, ...], key: str) -> ufl.Form:
    """A linear form on the blocks, without integrals of zero; refuses what is none."""
    if not isinstance(form, ufl.Form):
        example = "ufl.inner(traction, v) * ds('back')"
        raise InputError(f"{key} returned a {type(form).__name__}; return a form such as {example}")
    form = ufl.Form([one for one in form.integrals() if not isinstance(one.integrand(), Zero)])
    for integral in form.integrals():
        _check_integral(integral, known, key)
    problem = f"{key} must be linear in the test function v that it is given"
    try:
        arguments = form.arguments()
        if not form.empty():
            compute_form_data(form)
    except (Exception, ArityMismatch) as error:  # the last is no Exception in newer versions of UFL
        raise InputError(f"{problem}: {error}") from error
    if arguments != (v,) and not form.empty():
        raise InputError(f"{problem}, and in no other; it has {len(arguments)} arguments")
    return form


def _check_integral(integral: Any, known: tuple[ufl.Measure, ...], key: str) -> None:
    """Refuse integrals by other measures than those that are known, and on other meshes."""
    tags = {measure.integral_type(): measure.subdomain_data() for measure in known}
    kind = integral.integral_type()
    data = integral.subdomain_data()
    everywhere = data is None and integral.subdomain_id() == "everywhere"
    if kind not in tags or not (everywhere or data is tags[kind]):
        raise InputError(f"{key} has a measure of its own; use dx and ds, which it is given")
    used = {integral.ufl_domain()}
    for terminal in traverse_unique_terminals(integral.integrand()):
        used.update(extract_domains(terminal))
    if used != {known[0].ufl_domain()}:
        raise InputError(
            f"{key} uses another mesh than that of its blocks, scene.mesh.domain; take it from the"
            " measure, dx.ufl_domain()"
        )
