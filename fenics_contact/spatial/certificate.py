"""A collapse in space held against its problem: blocks, contacts and laws, not what solved it.

Every residual is recomputed from the forces at points and the motions of blocks alone. With the
forces' own strengths g = c A + (F - D) N of the points nothing carries more than

    (g . |v_T| - f_D . v) / f_L . v

for a motion of the blocks by which all points open: v_N >= D |v_T|.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fenics_contact.faces.certificate import FaceState
from fenics_contact.faces.model import CARRIED, FaceModel
from fenics_contact.geometry.mesh import Array
from fenics_contact.results.bounds import rounded
from fenics_contact.results.certificate import Certificate
from fenics_contact.results.result import Collapse
from fenics_contact.search_options import SEARCH
from fenics_contact.spatial.crushing import Crushing
from fenics_contact.spatial.structure import Structure

#: What a state may miss, in parts of its blocks' typical loads: of equilibrium and of its laws.
ALLOWED = {
    "equilibrium": 1e-7,
    "pressure": 1e-6,
    "friction": 1e-6,
    "ties": 1e-6,
    "mode_penetration": 1e-5,
    Crushing.key: 1e-5,  # a limit, in which it is told above `SEARCH.verified`
    "limit": SEARCH.rough_gap,
}


def missing_forces(structure: Structure, force: Array, tension: Array, load_factor: float) -> Array:
    """Forces and moments about centroids that are left over, N and N m, shape (blocks, 6)."""
    missing = structure.dead + load_factor * structure.live
    axes = structure.axes
    along = np.einsum("pk,pki->pi", force, axes[: len(force)])  # on the second block
    along = np.vstack([along, -tension[:, None] * axes[len(force) :, 1]])
    for sign, block, arm in structure.ends:
        vectors = np.hstack([along, np.cross(arm, along)])
        np.add.at(missing, block[block >= 0], sign * vectors[block >= 0])
    return missing[structure.number >= 0]


def relative_motions(structure: Structure, mode: Array) -> Array:
    """Motions of second ends against first ones along the axes of points, and then of bars."""
    motions = np.vstack([mode, np.zeros(6)])  # the last one: GROUND
    moved = np.zeros((len(structure.axes), 3))
    for sign, block, arm in structure.ends:
        moved += sign * (motions[block, :3] + np.cross(motions[block, 3:], arm))
    return np.asarray(np.einsum("pki,pi->pk", structure.axes, moved))


def residuals_of(structure: Structure, collapse: Collapse) -> dict[str, float]:
    """By how much a state misses equilibrium and its laws, relative.

    Of a collapse also what its mode misses, and its gap, recomputed.
    """
    force = collapse.force
    tension = collapse.tension
    mode = collapse.mode
    if force is None or tension is None:
        return {}
    count = len(force)
    laws = ("friction", "dilatancy", "tensile_strength")
    friction, dilatancy, tensile = (structure.of_points(law) for law in laws)
    tensile = tensile * structure.points.area
    strength = structure.shear_strength
    yields = structure.yields
    missing = missing_forces(structure, force, tension, collapse.load_factor)
    missing[:, 3:] /= structure.size
    size = np.fmax(abs(collapse.load_factor), collapse.size)
    loads = np.abs(structure.dead) + size * np.abs(structure.live)
    own = np.where(structure.number >= 0, loads[:, :3].max(axis=1), 0.0)
    typical = float(own.max()) or float(np.abs(structure.live).max())
    # As `FaceModel.sizes`: those of blocks, and of the ground; then of units.
    sizes = np.append(np.where(own > 0.0, np.minimum(CARRIED * own, typical), typical), typical)
    unit = np.minimum(*(sizes[block] for _, block, _ in structure.ends))[:count]
    normal = force[:, 0]
    shear = np.linalg.norm(force[:, 1:], axis=1)
    closes = structure.limited[structure.points.contact]
    found = {
        "equilibrium": float((np.abs(missing) / sizes[:-1][structure.number >= 0, None]).max()),
        "pressure": float(np.max((-normal - tensile) / unit)),
        "friction": float(np.max((shear - strength - friction * normal) / unit)),
        "ties": float(np.max(np.maximum(-tension, tension - yields), initial=0.0)) / typical,
    }
    if structure.pressed is not None:
        found[Crushing.key] = structure.pressed.miss(normal) / typical
    if mode is not None:
        moved = relative_motions(structure, mode)
        slip = np.linalg.norm(moved[:count, 1:], axis=1)
        opening = moved[:count, 0] - dilatancy * slip
        own = strength + (friction - dilatancy) * normal
        power = float(own @ slip + tensile @ np.maximum(opening, 0.0))
        power += float(yields @ np.maximum(moved[count:, 1], 0.0))
        power -= float(np.vdot(structure.dead, mode))
        work = float(np.vdot(structure.live, mode))
        # Contacts of limited pressure close, at a power that the programs know.
        penetration = float(np.max(-opening[~closes], initial=0.0))
        found["mode_penetration"] = penetration / float(np.abs(moved).max())
        apart = abs(power / work - collapse.load_factor) / collapse.size
        found["limit"] = (collapse.gap or 0.0) if np.any(closes) else apart
    return {name: max(value, 0.0) for name, value in found.items()}


def certified(structure: Structure, state: Collapse, size: float, asked: float) -> Collapse:
    """A state with its certificate, of a collapse with at least the gap that its mode proves.

    Args:
        structure: Blocks, contacts and laws.
        state: Forces, and of a collapse its mode.
        size: Load factor by which gaps are divided.
        asked: Largest gap, relative.
    """
    certificate = Certificate({}, np.nan, size=size, tolerance=asked, allowed=ALLOWED)
    residuals = residuals_of(structure, replace(state, certificate=certificate))
    if state.mode is None:  # which says nothing of a limit
        return replace(state, certificate=replace(certificate, residuals=residuals))
    gap = max(state.gap or 0.0, residuals.get("limit", 0.0))
    limit = state.load_factor + state.sign * gap * size
    certificate = replace(certificate, residuals=residuals, kinematic_factor=limit)
    return replace(state, gap=gap, certificate=certificate)


def as_collapse(
    structure: Structure, model: FaceModel, state: FaceState, sign: float, asked: float
) -> Collapse:
    """A state in the terms of the structure, held against it; no limit where it misses much.

    Nor is one that needs the reverse of the live load: the dead load alone stands.
    """
    size = model.size(state.load_factor)
    found = Collapse(
        "limit",
        rounded(sign * state.load_factor, size),
        mode=structure.mode(state.mode),
        engine="faces",
        gap=abs(state.gap),
        inside="friction",
        sign=sign,
        force=structure.point_forces(state.force),
        tension=structure.tensions(state.force),
    )
    found = certified(structure, found, size, asked)
    missed = found.certificate.failures if found.certificate else ()
    text = f"misses {', '.join(missed).replace('_', ' ')}" if missed else ""
    if not text and state.load_factor < -asked * model.size(0.0):
        text = "is one of the reversed live load"
    reason = f"the best state, with load factor {found.load_factor:.6g}, {text}"
    return replace(found, status="not_converged", reason=reason) if text else found


def held_against(structure: Structure, found: Collapse, force: Array) -> Collapse:
    """A state with the engine's forces, held against blocks, contacts and laws."""
    known = structure.point_forces(force), structure.tensions(force)
    factor = found.given or 0.0
    found = replace(found, load_factor=factor, force=known[0], tension=known[1])
    found = certified(structure, found, abs(factor), SEARCH.gap)
    text = found.certificate.missed if found.certificate else ""
    status = "not_converged" if text else "equilibrium"
    return replace(found, status=status, reason=f"the state misses {text}" if text else "")
