"""One wall by every method: they share the problem and its verification, and must agree.

Interior points with the friction bound iterated, in the equations, or both ("auto"); joint forces
as unknowns, the normal and tangential ones in turn ("splitting") or at once ("active-set"); and
the load factor raised from zero instead of the work of the live load ("auto, load").
"""

from pathlib import Path

from mpi4py import MPI

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, SolveOptions, limit_load
from fenics_contact.meshing import running_bond

AGREEMENT = 1e-5
FOLDER = Path(__file__).parent / "output" / "methods"

law = JointLaw("coulomb", friction=0.65)
options = [
    SolveOptions(method=method)
    for method in ("auto", "fixed-point", "monolithic", "splitting", "active-set")
]
options.append(SolveOptions(control="load"))


def say(*columns: object) -> None:
    """A row of the table, once."""
    if MPI.COMM_WORLD.rank == 0:
        print("{:12} {:>12} {:>11} {:>15} {:>8}".format(*columns), flush=True)


say("method", "load factor", "iterations", "factorisations", "seconds")
factors = {}
for solve in options:
    scene = Scene(
        mesh=BlockMesh.from_model(running_bond(bricks=3, courses=4)),
        materials={"default": Material(young=1.0e9, poisson=0.2, density=1019.368)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        joints={"default": law},
        foundations={"base": law},
        title="Wall in running bond",
        solve=solve,
    )
    result = limit_load(scene)
    result.write(FOLDER / f"{solve.method}_{solve.control}")
    name = solve.method if solve.control == "work" else f"{solve.method}, load"
    if result.status != "limit":
        raise SystemExit(f"{name}: {result.status}")
    factors[name] = result.load_factor
    iterations = sum(len(history.steps) for history in result.positive.history)
    seconds = f"{result.seconds['total']:.2f}"
    say(name, f"{result.load_factor:.8f}", iterations, result.factorizations, seconds)

if max(factors.values()) - min(factors.values()) > AGREEMENT * factors["auto"]:
    raise SystemExit(f"the methods disagree: {factors}")
print(f"pictures: {FOLDER}/*/collapse.png")
