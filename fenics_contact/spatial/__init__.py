"""Structures of rigid blocks in space: the engine of `faces`, with another geometry.

Blocks are convex polyhedra, or several that move as one. Where plane sides of two blocks touch, a
contact carries pressure and Coulomb friction at points. Blocks are rigid; faces are elastic.
"""
