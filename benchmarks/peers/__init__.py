"""Other programs and methods on the same scenes, a module each.

A peer has `solve(blocks, resolution, deadline) -> Answer`, `version()`, which is empty where it is
not installed, and RESOLUTIONS: what its results are refined by, coarse to fine. What it solves and
with which settings stands in its docstring. Peers see the blocks' outlines, none of this package.
"""

from __future__ import annotations

import importlib
from types import ModuleType

#: Peers by name.
PEERS = ("rigid-lp", "gilbert", "gilbert-clarabel", "siconos", "calculix")


def peer(name: str) -> ModuleType:
    """The module of a peer."""
    return importlib.import_module(f"benchmarks.peers.{name.replace('-', '_')}")
