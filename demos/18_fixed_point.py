"""The passes of the fixed point: Tresca limit loads whose bound on friction becomes Coulomb's.

Each pass has the limit load lambda_k for a given bound g_k on shear forces, and renews the bound
by F times its own normal forces (Mihai and Ainsworth). The wall is that of demo 03, with little
friction and with much.
"""

from pathlib import Path

import matplotlib.pyplot as plt
from mpi4py import MPI

from fenics_contact import Scene, limit_load

FOLDER = Path(__file__).parent / "output" / "fixed_point"
SCENE = Path(__file__).parent / "03_wall_w3.toml"

figure, (left, right) = plt.subplots(1, 2, figsize=(8.0, 3.2), layout="constrained")
for friction in (0.5, 0.65, 1.0):
    values = {"joints.default.friction": friction, "foundations.base.friction": friction}
    overrides = [f"{key}={value}" for key, value in values.items()]
    scene = Scene.from_file(SCENE, overrides=[*overrides, "solve.method=fixed-point"])
    result = limit_load(scene)
    if abs(result.load_factor - 0.355817) > 1e-5:
        raise SystemExit(f"friction {friction}: {result.load_factor}, should be 0.355817")
    history = result.positive.history[-1]
    passes = range(1, len(history.steps) + 1)
    left.plot(passes, [step.load_factor for step in history.steps], ".-", label=f"F = {friction}")
    right.semilogy(passes, [step.bound_change for step in history.steps], ".-")
    if MPI.COMM_WORLD.rank == 0:
        print(f"friction {friction}: {len(passes)} passes, contraction {history.contraction:.2f}")

left.set(xlabel="pass", ylabel="load factor with the given bound")
right.set(xlabel="pass", ylabel="change of the bound, relative")
left.legend(frameon=False)
if MPI.COMM_WORLD.rank == 0:
    FOLDER.mkdir(parents=True, exist_ok=True)
    figure.savefig(FOLDER / "passes.png", dpi=100)
    print(f"picture: {FOLDER}/passes.png")
