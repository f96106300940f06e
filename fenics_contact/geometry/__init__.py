"""Blocks as meshes: drawings, builders, gmsh files, refinement."""

from fenics_contact.requirements import check_requirements

check_requirements(mesh=False)
