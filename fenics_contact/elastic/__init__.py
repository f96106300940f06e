"""Elastic blocks in space: meshes of tetrahedra, and stresses under forces that are certified."""
