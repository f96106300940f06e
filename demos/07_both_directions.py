"""A wall with a buttress, pushed either way: the buttress holds it on one side only.

Pushed away from the buttress the wall tips alone, at width over height. Towards the buttress it
stands more, but no more than rigid blocks with associative friction.
"""

from pathlib import Path

from fenics_contact import BlockMesh, JointLaw, Load, Material, Scene, SolveOptions, limit_load
from fenics_contact.meshing import buttress

WIDTH, COURSE, COURSES = 1.0, 0.5, 6
FOLDER = Path(__file__).parent / "output" / "buttress"

law = JointLaw("coulomb", friction=0.7)
for picture, direction in (("away", "negative"), ("towards", "both")):
    scene = Scene(
        mesh=BlockMesh.from_model(buttress(COURSES, WIDTH, foot=1.5, height=COURSE)),
        materials={"default": Material(young=5e9, poisson=0.2, density=2400.0)},
        dead=Load(body=(0.0, -9.81)),
        live=Load(body=(9.81, 0.0)),
        joints={"default": law},
        foundations={"base": law},
        title="Wall with a buttress",
        solve=SolveOptions(direction=direction),
    )
    result = limit_load(scene)
    result.write(FOLDER / picture)

exact = -WIDTH / (COURSE * COURSES)
towards, away = result.load_factor, result.load_factor_negative
if abs(away - exact) > 1e-6:
    raise SystemExit(f"away from the buttress: {away}, should be {exact}")
if not 1.5 * abs(away) < towards <= result.positive.bounds.upper * (1.0 + 1e-9):
    raise SystemExit(f"towards the buttress: {towards}, should be near 0.536")
print(f"towards the buttress {towards:.6f}, away from it {away:.6f} times the weight")
print(f"pictures: {FOLDER}/*/collapse*.png")
