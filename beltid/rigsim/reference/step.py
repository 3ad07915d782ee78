"""Take reference steps: friction by Lemke's method on the Delassus matrix.

Slower than the active set of :mod:`beltid.rigsim.contact.friction` (a dense matrix in every
iteration) but independent of any guess of which patches stick. Both methods meet the same
certificate, and they agree.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from beltid.rigsim import banded, step
from beltid.rigsim.beam.belt import store_strains
from beltid.rigsim.beam.supports import give_way, missing_force, release, restrain, unit_movement
from beltid.rigsim.compiled import kernel
from beltid.rigsim.contact.friction import CONE_TOLERANCE, SLIP_TOLERANCE, Certificate, violations
from beltid.rigsim.contact.points import SLIDE, STICK, Motion, Points, fields_of, remember
from beltid.rigsim.model import System, Workspace
from beltid.rigsim.reference.lcp import friction_lcp
from beltid.rigsim.step import (
    MOST_HALVINGS,
    Drive,
    Kinematics,
    StepOutcome,
    Steps,
    accept,
    force_tolerance,
    largest_force,
    move,
    note_attempt,
    note_step,
)

Array = NDArray[np.float64]

# stand-alone versions, compiled in the first run of this solver
factorize, solve = kernel(banded.factorize), kernel(banded.solve)
assemble = kernel(step.assemble)

MOST_ITERATIONS = 60


def directions(points: Points, touching: NDArray[np.intp], n: int) -> Array:
    """Return the generalised force directions W_T of the touching patches, shape (n, m)."""
    W = np.zeros((n, touching.size))
    for i, e in enumerate(touching):
        W[4 * e : 4 * e + 8, i] = points.patches[e].pull
    return W


def lemke_step(
    system: System,
    motion: Motion,
    points: Points,
    state: Kinematics,
    stretch: float,
    T_0: float,
    work: Workspace,
) -> StepOutcome:
    """Take one implicit step by Lemke's method; the counterpart of ``step_forward``.

    Newton's method solves for the smooth forces; in each iteration a complementarity problem with
    the limits of the iterate gives the friction forces and slips of the linearised step.

    Raises
    ------
    LcpError
        If a complementarity problem has no solution.
    """
    motion = motion._replace(augmentation=0.0)
    tolerance = force_tolerance(system, motion, T_0)
    state.trial[:] = state.q + state.q_dot / motion.rate
    changes = 0
    error, certificate, outside = np.inf, Certificate(np.inf, np.inf, 0.0, 0.0), 0
    for iteration in range(MOST_ITERATIONS):
        outside = assemble(system, motion, points, state, stretch, work)
        error = largest_force(system, work.vectors[0])
        if system.supports.give_way:
            error = max(error, abs(missing_force(system.supports, work.reactions, T_0)))
        certificate = violations(system.belt, points)
        if (
            error <= tolerance
            and certificate.slip <= SLIP_TOLERANCE
            and certificate.cone <= CONE_TOLERANCE
        ):
            return StepOutcome(
                True, iteration, changes, error / T_0, stretch, motion.omega, outside, certificate
            )
        changes += _complementarity_iteration(system, motion, points, state, stretch, T_0, work)
    return StepOutcome(
        False, MOST_ITERATIONS, changes, error / T_0, stretch, motion.omega, outside, certificate
    )


def _complementarity_iteration(
    system: System,
    motion: Motion,
    points: Points,
    state: Kinematics,
    stretch: float,
    T_0: float,
    work: Workspace,
) -> int:
    """Solve the linearised step with friction and move the trial; return the number of pivots."""
    patches = fields_of(points.patches)
    # S of Eq. (12): sliding patches follow their limit, sticking ones carry a given force
    patches.la_T[:] = patches.force
    assemble(system, motion, points, state, stretch, work)
    factorize(work.A, work.pivots)
    supports, reactions, movement = system.supports, work.reactions, work.steps[-1]
    if supports.give_way:
        unit_movement(supports, reactions, work.A, work.pivots, movement)
    touching = np.flatnonzero(patches.limit > 0.0)
    force, slip = patches.force[touching].copy(), patches.slip[touching].copy()
    limits = patches.limit[touching].copy()
    W = directions(points, touching, state.q.size)
    compliance = np.empty_like(W)
    for i in range(touching.size):
        column = W[:, i].copy()
        restrain(supports, column)
        solve(work.A, work.pivots, column)
        if supports.give_way:
            give_way(supports, reactions, movement, 0.0, column)
        release(supports, column)
        compliance[:, i] = column
    free = -work.vectors[0]
    solve(work.A, work.pivots, free)
    if supports.give_way:
        missing = missing_force(supports, reactions, T_0)
        give_way(supports, reactions, movement, missing, free)
    release(supports, free)
    G = W.T @ compliance
    slip_free = slip - W.T @ free + G @ force
    wanted, slips, solution = friction_lcp(G, slip_free, limits)
    move(state.trial, free + compliance @ (wanted - force))
    patches.status[:] = SLIDE  # start of a closing patch, as in friction.revise
    patches.sign[:] = 1.0
    patches.la_T[:] = 0.0
    patches.la_T[touching] = wanted
    # slip or distance to the limit is zero except for rounding: the scaled larger one decides
    force_scale, slip_scale = np.max(limits, initial=0.0), np.max(np.abs(slip_free), initial=0.0)
    slides = np.abs(slips) * force_scale > (limits - np.abs(wanted)) * slip_scale
    patches.status[touching] = np.where(slides, SLIDE, STICK)
    patches.sign[touching] = np.where(slides, np.sign(slips), np.sign(wanted))
    return solution.pivots


def march_by_lemke(
    system: System,
    points: Points,
    state: Kinematics,
    drive: Drive,
    work: Workspace,
    record: Steps,
    begin: int,
    end: int,
) -> int:
    """Take steps with the reference solver; same interface as :func:`beltid.rigsim.step.march`."""
    patches = fields_of(points.patches)
    if begin == 0:
        remember(system.belt, points, state.q)
        store_strains(system.belt, state.q, drive.stretch, work.strain_old)
    for k in range(begin, end):
        parts, done, halvings = 1, 0, 0
        while done < parts:
            motion = Motion(float(record[k].omega), parts / float(record[k].dt), 1.0, 0.0)
            kept = [a.copy() for a in (patches.status, patches.sign, patches.la_T)]
            out = lemke_step(system, motion, points, state, drive.stretch, drive.T_0, work)
            note_attempt(record, k, out)
            if out.converged:
                accept(system, motion, points, state, drive.sticking_ratio)
                store_strains(system.belt, state.q, drive.stretch, work.strain_old)
                done += 1
                continue
            patches.status[:], patches.sign[:], patches.la_T[:] = kept
            record[k].halvings = halvings
            halvings += 1
            if halvings > MOST_HALVINGS:
                return k
            parts *= 2
            done *= 2
        record[k].halvings = halvings
        note_step(points, work, record, k, out)
    return end
