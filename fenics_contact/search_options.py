"""The numbers of all searches, in one place.

Scenes say what is asked (`SolveOptions`); these numbers say how it is looked for. `docs/build.md`
has what each of them is told by: a scene whose status, load factor or cost changes without it.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class SearchOptions:
    """Numbers of solvers, face engine, searches and certificates, each with unit and reason."""

    # ---- sizes that are alike everywhere
    #: Load factors are judged relative to themselves, or to this part of the typical one.
    small_factor: float = 1e-3
    #: Part of the way to the boundary of its cones that a step of an interior point method goes.
    step_fraction: float = 0.995
    #: First work of a limit load, in units of that on the bonded structure.
    first_work: float = 300.0
    #: Factor from one work to the next, where one was too little.
    work_growth: float = 10.0

    # ---- Newton's equations of a state (solvers/kkt)
    #: Cap on springs of joints, in units of K's mean diagonal: larger ones would cancel digits.
    largest_spring: float = 1e10
    #: Spring against steps, not slip, where there is no friction, in units of force over
    #: displacement: without it blocks on frictionless joints have no stiffness.
    sliding_spring: float = 1e-8
    #: Times by which parts of a direction are larger than their sum where it is solved for again:
    #: its digits have cancelled.
    cancellation: float = 10.0
    #: Weight of the equilibrium residual: stiff springs cancel some of its digits while the iterates
    #: still move; it recovers as they come to rest.
    equilibrium_weight: float = 1e-3
    #: Least distance of shear from its bound, in units of it, at a state from elsewhere.
    from_bound: float = 1e-9

    # ---- interior point method for a state (solvers/interior_point)
    #: Steps at most.
    interior_steps: int = 80
    #: Steps over which the error has to halve; else the method has stalled.
    interior_window: int = 20
    #: Error up to which a stalled state is accepted where less was asked for: at the limit load
    #: digits are lost. What it is worth the certificate tells.
    interior_acceptable: float = 1e-9
    #: Change of the load factor at most in the step to such a state, in units of that asked for.
    settled_change: float = 20.0
    #: Steps at most from the first iterate that is exact enough, while its load factor changes.
    resting_steps: int = 3
    #: Products that are aimed at, at least, in units of the tolerance.
    least_products: float = 1e-2
    #: Length up to which a step is replaced by one to equal products.
    short_step: float = 0.1
    #: Weights of the corrector that are tried.
    corrector_weights: int = 9

    # ---- continuation of the central path (solvers/arclength)
    #: Factorisations at most.
    path_steps: int = 600
    #: Steps in which the path has to advance by log 2; else it wanders.
    path_patience: int = 120
    #: Largest change of s in one step; of its logarithm where the work rises.
    path_change: float = 3.0
    #: Change of s for which the points are chosen that follow their laws.
    path_aimed: float = 2.0
    #: Part of the end at which a path ends, so that rounding does not fall short of it.
    path_past: float = 1e-3
    #: Distance from the path that may be left at its end, relative to p and q.
    path_close: float = 0.1
    #: Steps at most to get that close.
    path_corrections: int = 6
    #: By how much less far from the laws a step leads that is made again.
    path_shorter: float = 0.3
    #: Least such distance, in units of the usual one.
    path_least: float = 0.03
    #: Steps in a row that do not reach the path, until it is lost.
    path_lost: int = 6
    #: Size of p and q by which changes are measured, at least, in typical units: smaller ones are of
    #: no consequence.
    path_smallest: float = 1e-3

    # ---- one step of it: points that follow their exact laws (solvers/nonlinear_elimination)
    #: Points chosen at most, before a step.
    points: int = 32
    #: Points at most that are chosen at once where they end the way to the path.
    late_points: int = 16
    #: Times that points are chosen late in one step.
    late_rounds: int = 8
    #: Distance from its law, relative to p and q, from which on a point is chosen.
    chosen_from: float = 0.15
    #: Largest distance of a point that is not chosen.
    allowed_distance: float = 0.3
    #: What is left of the equations of chosen points, relative to p and q.
    points_solved: float = 3e-2
    #: Times that the interval is halved in which more points begin to bend than may be chosen.
    bisections: int = 6
    #: Length of s at least on either side of where the path is reached.
    path_room: float = 1e-4

    # ---- states by joint forces (solvers/joint_forces)
    #: Largest rho, in units of typical joint force over displacement: larger ones take more proximal
    #: steps, with smaller ones programs are harder to solve, and digits are lost.
    hold: float = 0.1
    #: Factor from one rho to the next smaller one.
    hold_factor: float = 0.2
    #: Number of them.
    holds: int = 7
    #: Joint laws that are missed by so many times more than equilibrium call for a larger rho.
    hold_balance: float = 1e2
    #: A step that contracts less than this calls for a smaller one.
    slow_hold: float = 0.3
    #: Hold on the forces, in units of the diagonal: makes programs definite.
    force_hold: float = 1e-7
    #: Steps without half the residual after which the best state is judged.
    hold_patience: int = 12
    #: What such a state may miss.
    hold_acceptable: float = 1e-7
    #: Tolerance on programs, relative to the change in the last step.
    program_accuracy: float = 1e-3
    #: Residual at which sweeps end, likewise.
    sweep_accuracy: float = 0.1
    #: Sweeps that contract less than this are ended by a step for all forces.
    slow_sweep: float = 0.1

    # ---- block modes and factors (solvers/block_modes, solvers/joint_stiffness)
    #: c of the indentation of blocks: a fit to bricks of 6 to 561 nodes, linear triangles; within a
    #: third from 15 nodes on.
    indentation: float = 0.6
    #: Unknowns up to which the minimum fill ordering is used, which is quicker to find than the
    #: default; beyond the default needs less memory.
    minimum_fill: int = 100_000


#: What every search reads.
SEARCH = SearchOptions()
