"""Programs that this package needs, those that pip does not install, and the ways to them."""

from __future__ import annotations

from importlib.util import find_spec


class MissingError(ImportError):
    """A module is not installed; the message has the ways to it."""


#: Modules without which no meshed scene is solved; gmsh is needed for most meshes.
OF_MESHES = ("dolfinx", "petsc4py", "mpi4py")

#: Modules without which nothing is solved; pip installs them.
BY_PIP = ("numpy", "scipy", "matplotlib", "shapely")

#: Ways to these modules, for people.
WAYS = """\
Debian, Ubuntu:  apt install python3-dolfinx python3-petsc4py python3-mpi4py python3-gmsh,
                 then python3 -m venv --system-site-packages
Windows:         the same in WSL, with Debian or Ubuntu
macOS, others:   conda env create -f environment.yml  (conda-forge's fenics-dolfinx)
container:       docker build -t fenics-contact .
Which of these were tested: docs/platforms.md"""


#: Ways to gmsh, for people.
GMSH_WAYS = "apt install python3-gmsh, conda install python-gmsh or pip install gmsh"

#: What needs none of these, for people.
RIGID = 'rigid blocks: [blocks] file = "wall.msh" or "wall.dxf" in place of [mesh]'


def missing_requirements(mesh: bool = True, key: str = "") -> str:
    """Message with the modules that are not installed and the ways to them; else empty.

    Args:
        mesh: Whether a scene has a mesh; rigid blocks without one do with what pip installs.
        key: What needs the modules of meshes in a scene without a mesh.
    """
    texts = []
    by_pip = f"(pip install {' '.join(BY_PIP)})"
    by_other_ways = f"(FEniCSx), and pip does not install them. Ways:\n{WAYS}\n"
    by_other_ways += f"without them:    {f'leave out {key}' if key else RIGID}"
    of_meshes = OF_MESHES if mesh else ()
    for needed, cure in ((BY_PIP, by_pip), (of_meshes, by_other_ways)):
        if names := [name for name in needed if find_spec(name) is None]:
            listed = " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))
            texts.append(f"{listed} {'is' if len(names) == 1 else 'are'} not installed {cure}")
    return "; ".join(texts)


def check_requirements(mesh: bool = True, key: str = "") -> None:
    """Refuse to go on without the modules that are needed, see `missing_requirements`.

    Raises:
        MissingError: With the ways to them.
    """
    if message := missing_requirements(mesh, key):
        raise MissingError(f"fenics_contact: {message}")
