"""Blocks as meshes: drawings, builders, gmsh files, refinement."""
