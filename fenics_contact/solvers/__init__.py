"""Solvers of the discrete contact problem: PETSc and numpy only, no mesh, no scene."""
