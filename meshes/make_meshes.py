"""Write the meshes of the four walls of Ferris and Tin-Loi (Int. J. Mech. Sci. 43 (2001) 209)."""

from __future__ import annotations

import sys
from pathlib import Path

import gmsh

from fenics_contact.meshing import wall

E = [0.5, 1, 1, 1, 1, 0.5]
U = [1, 1, 1, 1, 1]
W3 = {
    "E": [1, 1, 1, 1],
    "U": [0.5, 1, 1, 1, 0.5],
    "e": [1, 0.5, -1, 0.5, 1],
    "u": [0.5, 1, -1, 1, 0.5],
}
W4 = {"E": E, "U": U, "u": [1, -1, 1, -1, 1], "e": [0.5, 0.5, -1, 0.5, 0.5, -1, 0.5, 0.5]}

#: Courses from the bottom, lengths in blocks of 0.4 m x 0.175 m, voids negative.
WALLS = {
    "w1": [E, U] * 3,
    "w2": [E, U] * 5,
    "w3": [W3[course] for course in "EUEueueuEUE"],
    "w4": [W4[course] for course in "EUEueueuEUE"],
}

if __name__ == "__main__":
    here = Path(__file__).parent if len(sys.argv) < 2 else Path(sys.argv[1])
    for name, courses in WALLS.items():
        wall(courses, elements=2)
        gmsh.write(str(here / f"{name}.msh"))
