"""The wall of demo 03 in a few lines of Python, with its files."""

from pathlib import Path

from fenics_contact import Scene, limit_load

FOLDER = Path(__file__).parent / "output" / "six_lines"

scene = Scene.from_file(Path(__file__).parent / "03_wall_w3.toml")
result = limit_load(scene)
result.write(FOLDER)
print(result.status, result.load_factor, result.bounds)

if abs(result.load_factor - 0.35582) > 1e-4:
    raise SystemExit(f"load factor {result.load_factor}, should be 0.35582")
print(f"pictures: {FOLDER}/collapse.png, thrust.png, stress.png")
