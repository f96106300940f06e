"""Work that a scene does not need, said in the log and in result.json."""

from __future__ import annotations

from collections.abc import Sequence

from fenics_contact.results.history import History
from fenics_contact.scene.scene import Scene

FIXED_POINT = "fixed point on the friction bound"


def skipped(scene: Scene) -> tuple[str, ...]:
    """Parts of the analysis that a scene spares, each with its reason."""
    laws = [*scene.joints.values(), *scene.foundations.values()]
    direction = scene.solve.direction
    output = scene.output
    other = "positive" if direction == "negative" else "negative"
    reasons = {
        f"{FIXED_POINT}: no joint has Coulomb friction": not any(law.friction for law in laws),
        "shear forces: no joint has friction": not any(
            law.friction or law.bound or law.cohesion for law in laws
        ),
        "dead tractions: none given": not scene.dead.traction,
        "dead body force: none given": not any(scene.dead.body),
        "live tractions: none given": not scene.live.traction,
        "live body force: none given": not any(scene.live.body),
        f"{other} direction: solve.direction = '{direction}'": direction != "both",
        "all but the load factor and its bracket: solve.fast = true": scene.solve.fast,
        "load steps: joints that crush have no loading path": (
            scene.crushes and scene.solve.control == "load"
        ),
        "capacity curve: output.capacity = 0": not output.capacity,
        "stress recovery and ParaView files: output.paraview = false": not output.paraview,
        "pictures: output.pictures = false": not output.pictures,
    }
    return tuple(text for text, applies in reasons.items() if applies)


def skipped_iterations(histories: Sequence[History]) -> tuple[str, ...]:
    """Iterations that turned out not to be needed, by the histories of all states found."""
    if {(history.method, len(history.steps)) for history in histories} != {("monolithic", 1)}:
        return ()
    return (f"{FIXED_POINT}: the monolithic step alone found the state",)
