"""The numbers of all searches, in one place.

Scenes say what is asked (`SolveOptions`); these numbers say how it is looked for.
`benchmarks/README.md` has what each of them is told by: a scene whose status, load
factor or cost changes without it.
"""

from __future__ import annotations

import math
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
    #: Works at most that are tried in vain.
    works: int = 3
    #: Steps, or iterations, without progress at which a method has lost its way; and to get close
    #: to a path; halvings of an interval of points.
    no_progress: int = 6
    #: A decade: from one work, size of products, or rho of joint forces, to the next; by which
    #: steps and sweeps should contract; how near to growth without limit load factors are
    #: unlimited; and cosine of tangents from which on a path goes straight on.
    decade: float = 0.1
    #: Digits of what is exact, relative: joint forces next to a collapse, equilibrium of faces, a
    #: stalled interior point method where less was asked for, HiGHS but for a decade. Parts of the
    #: largest force or slip rate, or of a bound, that are as good as nothing.
    digits: float = 1e-9
    #: Relative sizes that rounding makes: of missing forces, of a prescribed work, of proved ends.
    rounding: float = 1e-8
    #: What makes systems definite, relative: added to Newton's matrix of faces (times the gap), to
    #: the strengths for which a mode is found, and to the diagonal for joint forces.
    regularization: float = 1e-7
    #: Load factors agree that are as close as this, relative; and what a state may miss of
    #: friction, the direction of slip, and its mode of penetration, power and straining.
    agrees: float = 1e-5
    #: Those are of different states that are as far apart as this.
    far_apart: float = 2e-2
    #: Motions, and what is left of a strength, below this part of the largest one are none.
    slight: float = 1e-4

    # ---- Newton's equations of a state (solvers/kkt)
    #: Cap on springs of joints, in units of K's mean diagonal: none but in an elastic mode.
    largest_spring: float = math.inf
    #: Spring against steps, not slip, where there is no friction, in units of force over
    #: displacement: without it blocks have no stiffness. Blocks that are strained by given forces
    #: are held by it, in units of K's mean diagonal.
    sliding_spring: float = 1e-8
    #: Times by which parts of a direction are larger than their sum where it is solved for again:
    #: its digits have cancelled.
    cancellation: float = 10.0
    #: Weight of the equilibrium residual: stiff springs cancel some of its digits while iterates
    #: move; it recovers as they come to rest.
    equilibrium_weight: float = 1e-3

    # ---- interior point method for a state (solvers/interior_point)
    #: Steps at most.
    interior_steps: int = 80
    #: Steps over which the error has to halve; else the method has stalled.
    interior_window: int = 20
    #: Steps at most from the first iterate that is exact enough, while its load factor changes; and
    #: `interior_window` at hinges.
    resting_steps: int = 3
    #: Products that are aimed at, at least, in units of the tolerance.
    least_products: float = 1e-2
    #: Weights of the corrector that are tried.
    corrector_weights: int = 9

    # ---- continuation of the central path (solvers/arclength)
    #: Steps in which the path has to advance by log 2; else it wanders: it needs 19 at most where
    #: it is followed.
    path_patience: int = 40
    #: Largest change of s in one step; of its logarithm where the work rises.
    path_change: float = 3.0
    #: Change of s for which the points are chosen that follow their laws.
    path_aimed: float = 2.0
    #: Length of s at least on either side of where the path is reached.
    path_room: float = 1e-4
    #: By how much less far from the laws a step leads that is made again.
    path_shorter: float = 0.3
    #: Least such distance, in units of the usual one: random 85 and 283 end elsewhere without it.
    path_least: float = 0.03

    # ---- one step of it: points that follow their exact laws (solvers/nonlinear_elimination)
    #: Points chosen at most, before a step; half as many at once where they end the way to it.
    points: int = 32
    #: Times that points are chosen late in one step.
    late_rounds: int = 8
    #: Largest distance of a point that is not chosen; half as far from its law, relative to p and
    #: q, one may be chosen.
    allowed_distance: float = 0.3
    #: What is left of the equations of chosen points, relative to p and q.
    points_solved: float = 3e-2

    # ---- block modes and factors (solvers/block_modes, solvers/joint_stiffness)
    #: c of the indentation of blocks: a fit to bricks of 6 to 561 nodes, linear triangles; within a
    #: third from 15 nodes on.
    indentation: float = 0.6
    #: Displacements of a large system: up to so many the minimum fill ordering is used, which is
    #: quicker to find and needs more memory, and a mesh is refined for an accuracy.
    large_system: int = 200_000

    # ---- programs on face forces (faces/kernel, faces/programs)
    #: Relative gap at which a program ends; products that are as good as nothing.
    face_gap: float = 1e-7
    #: Length below which a step is short.
    face_short: float = 0.2
    #: Steps without a better iterate that end it.
    face_stale: int = 12
    #: Further correctors at most.
    pushes: int = 2

    # ---- programs on many blocks (faces/kernel, faces/limit)
    #: Motions above which blocks are many, and convex programs come first: 3 300 blocks in the
    #: plane, 1 700 in space. Coulomb's law in an elastic state takes steps of a tenth there.
    many_motions: int = 10_000
    #: `interior_steps`, `face_stale` and `no_progress` are so many times as large, and `face_short`
    #: as small: these programs go on after runs of single steps of a twentieth.
    many_patience: int = 3

    # ---- search for a limit by face forces (faces/limit, faces/certificate)
    #: Relative gap of a state that counts as one at all; how far, relative, the load factor may
    #: move where no state is found nearer; and the thinnest slice of a bracket.
    rough_gap: float = 1e-2
    #: Steps at most.
    face_rounds: int = 10
    #: Relative gap of each; part of the dissipation that the bound misses, from which on the
    #: certificate is tried; change of pressing forces below which steps end; and how far the load
    #: factor may move at most: a state farther away is another's. With many blocks, of the gap
    #: asked for, or proved, the part at which a program ends.
    part_gap: float = 3e-2
    #: Part of the elastic state's gap by which the load factor may move.
    moves: float = 0.3

    # ---- loading path by face forces (faces/follow)
    #: Work at its end, in units of that of a typical live load on closed faces: plateaus are wide.
    follow_works: float = 1e4
    #: Factorisations of one way at most from `large_wall` blocks on; below, `collapse_cost`.
    follow_large_effort: int = 250
    #: Part of the pressing forces under the dead load with which the bound of "half" begins.
    little_friction: float = 0.3
    #: Longest step, in relative changes of p and q; what is left of one that leads to nothing.
    follow_longest: float = 1.5
    follow_shorter: float = 0.4

    # ---- lower states by face forces (answers/lowest)
    #: Gap of a state at most.
    lower_state_gap: float = 1.5e-4
    #: Friction of a start at most: with more, elastic states next to several collapse states are
    #: alike. That of stones is less.
    start_friction: float = 1.0
    #: Factorisations of one start at most, unasked.
    usual_effort: int = 150

    # ---- which engine, and what it is asked for (collapse/engine, collapse/face_collapse)
    #: Blocks from which on a wall is large: its path has larger products, and has to end soon.
    large_wall: int = 100
    #: Cost of the path of such a wall, in factorisations: about 20 bonded solves.
    soon: float = 25.0
    #: Gap asked for by default; five times that of ten times as many blocks, for which lower states
    #: are not looked for unasked.
    gap: float = 1e-3

    # ---- linear programs of rigid blocks (collapse/rigid_blocks)
    #: Iterations of HiGHS at most, for each row and column: it may go round in circles.
    program_iterations: int = 50
    #: Unknowns above which a program takes a second or more: it gets a process of its own, or the
    #: face engine.
    large_program: int = 5000
    #: Programs of the search for a lower end at most.
    programs: int = 120
    #: Its iterations of HiGHS times equations at most, which bounds the time on large walls.
    pivots: int = 2_500_000
    #: Least gain of a step, in units of the slice: for less, slices get smaller,
    least_gain: float = 0.05
    #: by this factor,
    slice_shrinks: float = 0.25
    #: Faces for each of which the least normal force is found by one program.
    faces_at_once: int = 8

    # ---- what counts as verified (results/certificate, collapse/collapse_mode)
    #: What a state may miss of its conditions, and of the limit with its own friction, in typical
    #: units; and how far a mode by face forces may close, or miss stationarity. Forces below this
    #: part of the largest one are none.
    verified: float = 1e-6
    #: The load factor of one state changes by so many times its gap at most with more work.
    same_state: float = 100.0
    #: Products of open and sliding joints in an elastic mode, force times displacement.
    mode_products: float = 1e-12
    #: Cap on springs of closed joints in it, in units of K's mean diagonal.
    mode_spring: float = 1e3

    # ---- path to a collapse (collapse/strategy); products in force times elastic displacement
    #: Products while the work rises. Smaller ones take more steps, larger ones miss low states.
    rising_products: float = 1e-2
    #: They grow like this power of the number of blocks of large walls, whose paths turn back more.
    products_of_many: float = 0.8
    #: Where block modes are left, and the interior point method is tried first; then a decade
    #: less, down to the tolerance. Next to a state at another load they are a decade larger; at
    #: nearly the same one, and on block modes to a peak, a decade smaller.
    end_products: float = 3e-3

    # ---- growing work, its costs (collapse/work_control), in factorisations of the structure
    #: First work per square of the number of blocks, if that is more: large walls are far from
    #: their plateau.
    work_of_many: float = 0.2
    #: Works, and load factors, that are looked at, in units of the first, and typical, ones.
    largest: float = 1e3
    #: Gap of a collapse state, in units of the tolerance: as its friction bound follows, the load
    #: factor still changes by 10 to 40 times as much.
    work_gap: float = 2.5e-2
    #: Cost of a collapse at most, half of it for one attempt; and of a search by face forces.
    collapse_cost: float = 600.0
    #: The same with iterations on the bound, some 10 states with given friction; of all collapses
    #: while joints tear; and with load control.
    iterated_cost: float = 3000.0
    #: Tolerance on load factors unless another one is asked for.
    usual_tolerance: float = 1e-6

    # ---- fixed point on the friction bound (collapse/coulomb)
    #: Iterations at most; and collapses while joints tear.
    bound_iterations: int = 150
    #: Largest relaxation.
    largest_relaxation: float = 2.0
    #: Factor of what secants promise: slow directions hide among others.
    secant_safety: float = 3.0
    #: Tolerance of a state by joint forces, in units of the last change of the bound; by the
    #: interior point method it is the square of that. Its programs are a decade more exact than the
    #: last change of forces.
    bound_precision: float = 1e-2

    # ---- rising load (collapse/load_control)
    #: Accuracy, relative, of load factors beside the one that is reported: of the peak, of lower
    #: states, and with load control. A dip is stepped over to one five times that higher. In space
    #: states are looked for beside elastic ones of this gap, `rough_gap` in the plane: many points
    #: of a face share its pressure, and a twisted block carries 30 % more next to a state of 1e-2.
    side_accuracy: float = 1e-4

    # ---- peak of the path (answers/peak)
    #: A load factor is higher than another one by this, relative; so much a path falls past a peak.
    higher: float = 2e-3
    #: Cost until something is seen, in units of that of the collapse,
    peak_seen: float = 1.5
    #: then in all, and where the peak was asked for.
    peak_asked: float = 50.0
    #: Blocks from which on it is looked for only if asked.
    peak_blocks: int = 380
    #: Where the load factor of the path with its larger products fell by this, relative, block
    #: modes do not tell that there is no peak.
    dip: float = 5e-2
    #: `path_change` on block modes: peaks are narrow,
    peak_change: float = 0.8

    # ---- what a load factor owes to the mesh (answers/hinges, accuracy)
    #: Cost of hinges of other lengths, in units of that of the collapse, unasked,
    hinge_share: float = 0.5
    #: and where it is asked for.
    hinge_asked: float = 3.0
    #: Halvings of the elements at hinges: first state; ten times as many in the second one.
    few_halvings: float = 30.0
    #: Halvings of a block's height that lead to a hinge of the mesh, about; measured.
    own_halvings: float = 2.0
    #: Displacements that change joint forces by their own size, in units of those at the work.
    hinge_give: float = 3e-3
    #: Steps across the path while joints settle,
    hinge_corrections: int = 2
    #: with so many `points`.
    hinge_points: int = 12
    #: Meshes at most until an accuracy is reached,
    meshes: int = 8


#: What every search reads.
SEARCH = SearchOptions()
