"""Wall 3 of Ferris and Tin-Loi from its gmsh mesh and scene file, with all files and pictures.

The same as `fenics-contact solve demos/03_wall_w3.toml -o demos/output/w3`, and a check: their
rigid-block value is 0.35582 (Int. J. Mech. Sci. 43 (2001) 209-224).
"""

import json
import sys
from pathlib import Path

from fenics_contact.cli import main

here = Path(__file__).parent
folder = here / "output" / "w3"
code = main(["solve", str(here / "03_wall_w3.toml"), "-o", str(folder)])
record = json.loads((folder / "result.json").read_text())
if code != 0 or record["status"] != "limit" or abs(record["load_factor"] - 0.35582) > 1e-4:
    sys.exit(f"load factor {record['load_factor']}, should be 0.35582")
