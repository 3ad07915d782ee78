"""Rod level of a belt drive: one pulley with the bending stiffness of the belt and its elastic bed.

The belt flows through a fixed shape: this is the rig of :mod:`beltid.rigsim` with three changes.
The momentum of the belt lowers the axial force, ``N - m v0**2 (1 + eps)``; a point slides with the
speed ``R (omega - v0 dtheta/dS)``, in either direction; and in addition to the stretch the speed of
the pulley is unknown, because the forces of both spans are given. In a steady flow friction has no
history, so there are no time steps. The derivation is in docs/theory.md, "The belt drive: rod
level".
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from beltid.drive.geometry import following, preceding
from beltid.drive.model import Drive
from beltid.errors import ConvergenceError, InputError
from beltid.laws.friction_surface import FrictionSurface
from beltid.laws.penalty import NormalLaw
from beltid.laws.slow_friction import HALF_TREND, continued
from beltid.params import Belt, Contact, OperatingPoint, Rig
from beltid.rigsim.beam.belt import belt_arrays
from beltid.rigsim.beam.path import bed_length, bending_length
from beltid.rigsim.contact.friction import CONE_TOLERANCE, Certificate
from beltid.rigsim.contact.points import (
    MOST_ZONES,
    SLIDE,
    SLIDES,
    STICK,
    Patches,
    Points,
    fields_of,
    new_points,
)
from beltid.rigsim.contact.ribs import certify
from beltid.rigsim.model import Bench, RigModel, System, Workspace
from beltid.rigsim.profile import ContactState
from beltid.rigsim.steady import lay_on
from beltid.rigsim.step import Drive as Given
from beltid.rigsim.step import (
    Flow,
    Kinematics,
    Steps,
    march,
    new_kinematics,
    schedule,
)

Array = NDArray[np.float64]

SHORTEST_SPAN = 6.0  # in bending lengths: the bending at pulleys further apart does not interact
# parts of an element of the rig: at the entry, where sliding changes direction within short zones,
# and on the rest of the arc
AT_ENTRY, ON_ARC = 8, 2
ENTRY = (-1.0, 4.0)  # from the tangent point, in lengths of the elastic bed
# slip over the speed of the belt at which a soft patch reaches its friction [-]
SOFTNESS = (2.0e-2, 2.0e-3, 2.0e-4, 2.0e-5, 2.0e-6, 2.0e-7)
SLIP_TOLERANCE = 1.0e-11  # of a patch that sticks, over the speed of the belt [-]
LAID = (0.25, 0.5, 0.75, 1.0)  # shares of the friction, ramped up while the whole arc slides
MOST_ROUNDS = 80
FREE_ROUNDS = 12  # rounds in which all patches may change state at once
MOST_SWITCHES = 4  # state changes of a patch at an end of the contact
MOST_SOFT_SWITCHES = 8  # state changes of a soft patch; the hard patches settle the others
PATIENCE = 3  # later rounds after which the allowed number of changes is halved
SOFTER = 4.0  # factor by which the ribs are softened if no state was found
SOFTEST = 1.0e6  # largest total factor
LONGER = 1.4  # growth of the steps on the way back to the requested stiffness
LEAST_STEP = 0.01  # smallest step of the logarithm of the stiffness
MOST_WITH_SOFTER = 150  # rounds
MORE_FRICTION = 1.5
# sqrt(EA/k_s) over the length of the elastic bed: ribs with a smaller ratio count as rigid
SHORTEST_SHEAR = 0.12
TYPICAL_FORCE = 5000.0  # line force at which that length is evaluated [N/m]


def ribs_shear(of: RodPulley | Drive) -> bool:
    """Return whether the ribs shear over a length that the rod resolves."""
    assert of.law is not None
    bed_stiffness = float(of.law.stiffness(of.law.penetration(TYPICAL_FORCE)))
    bed = bed_length(of.belt.EI, bed_stiffness)
    return math.sqrt(of.belt.EA / of.shear_stiffness) > SHORTEST_SHEAR * bed


@dataclass(frozen=True, slots=True)
class RodPulley:
    """A pulley of a drive with the belt on it, and a separate mesh.

    Parameters
    ----------
    belt : Belt
        Section properties; the mass acts in the running belt, the damping does not.
    law : NormalLaw
        Normal contact law, Eq. (3).
    surface : FrictionSurface
        Measured coefficient of friction over line force and sliding speed.
    R : float
        Radius of the belt's centreline on the pulley without load [m].
    wrap : float
        Angle between the tangent points [rad].
    span : float
        Length of belt on each side that is computed with the pulley [m].
    tension : float
        Typical span force, which determines the mesh [N].
    points_per_element : int
        Contact points per element.
    elements : int, optional
        Number of elements, even, of a mesh like that of the rig; by default the rig's default mesh,
        refined on the arc and more so at the entry.
    shear_stiffness : float
        Tangential force of the ribs per stress-free length and displacement [N/m²]; infinite if
        they do not shear, and assumed infinite if they hardly do, see :func:`ribs_shear`.
    slow_trend : float
        Share of the trend with which friction is extrapolated below the slowest speed, (D14) [-].

    Raises
    ------
    InputError
        If a parameter is out of range, or the span is shorter than six bending lengths
        ``sqrt(EI/tension)``, so that the bending at its two pulleys would interact.
    """

    belt: Belt
    law: NormalLaw
    surface: FrictionSurface
    R: float
    wrap: float
    span: float
    tension: float
    points_per_element: int = 5
    elements: int | None = None
    shear_stiffness: float = math.inf
    slow_trend: float = HALF_TREND
    model: RigModel = field(init=False, repr=False, compare=False)
    behind_entry: int = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        rig = Rig(self.R, self.span)
        contact = Contact(C_P=0.0, points_per_element=self.points_per_element)
        point = OperatingPoint(self.wrap, self.tension, 1.0)
        shortest = SHORTEST_SPAN * bending_length(self.belt.EI, self.tension)
        if self.span < shortest:
            raise InputError(
                f"span {1e3 * self.span:.4g} mm, must be >= {1e3 * shortest:.4g} mm, six bending "
                f"lengths at {self.tension:g} N: the bending at closer pulleys would interact"
            )
        bench = Bench(self.belt, rig, contact, self.law, self.surface)
        model = bench.model(point, self.elements)
        delta = float(self.law.penetration(self.tension / self.R))
        bed = bed_length(self.belt.EI, float(self.law.stiffness(delta)))
        if self.elements is None:
            nodes = self._divided(model.nodes, bed)
            arrays = belt_arrays(self.belt, nodes, self.points_per_element)
            model = replace(model, nodes=nodes, system=model.system._replace(belt=arrays))
        friction = continued(self.surface, self.slow_trend)
        contact_of_ribs = model.system.pulley._replace(surface=friction)
        model = replace(model, system=model.system._replace(pulley=contact_of_ribs))
        first = int(np.searchsorted(model.nodes, self.span + ENTRY[1] * bed))
        object.__setattr__(self, "behind_entry", first)
        object.__setattr__(self, "model", model)

    def _divided(self, nodes: Array, bed: float) -> Array:
        """Refine the nodes of the rig on the arc, and more so at the entry."""
        arc_end = self.span + self.R * self.wrap
        pieces = []
        for begin, end in itertools.pairwise(nodes):
            middle = 0.5 * (begin + end)
            from_entry = (middle - self.span) / bed
            parts = AT_ENTRY if ENTRY[0] < from_entry < ENTRY[1] else ON_ARC
            if not self.span - bed < middle < arc_end + bed:
                parts = 1
            pieces.append(np.linspace(begin, end, parts, endpoint=False))
        return np.concatenate([*pieces, nodes[-1:]])


@dataclass(frozen=True, slots=True)
class RodState:
    """Steady state of a running pulley.

    Attributes
    ----------
    v0 : float
        Stress-free length of belt that passes a point per second [m/s].
    W : float
        Speed of the pulley over ``v0`` [1/m].
    torque : float
        Torque of the shaft on the belt [N m], > 0 for a driver.
    P_in, P_out : float
        Effective forces of the entering and the leaving span, ``N - m v0**2 (1 + eps)`` [N].
    friction_power : float
        Power that friction takes [W].
    whole_slip : float
        Sliding speed of a pulley that slides as a whole, evaluated behind the entry [m/s]; else 0.
    contact : ContactState
        Contact along the arc, from the entry on; sliding speeds are > 0 where the pulley is faster
        than the belt.
    points : Points
        State of the contact points.
    certificate : Certificate
        Slip speed of sticking patches, or backward slip of sliding ones [m/s]; force beyond the
        cone.
    residual : float
        Largest residual force over ``P_in`` [-].
    iterations : int
        Newton iterations.
    outside : int
        Number of look-ups outside the measured range of the surface.
    """

    v0: float
    W: float
    torque: float
    P_in: float
    P_out: float
    friction_power: float
    whole_slip: float
    contact: ContactState
    points: Points
    certificate: Certificate
    residual: float
    iterations: int
    outside: int


def pulley_map(
    pulley: RodPulley,
    v0: float,
    P_in: float,
    *,
    P_out: float | None = None,
    torque: float | None = None,
    W: float | None = None,
    start: RodState | None = None,
) -> RodState:
    """Find the steady running of a belt over one pulley, given the force of the entering span.

    Parameters
    ----------
    pulley : RodPulley
        Pulley and belt.
    v0 : float
        Stress-free length of belt that passes a point per second [m/s], > 0.
    P_in : float
        Effective force of the entering span [N], > 0.
    P_out, torque, W : float
        Exactly one of: effective force of the leaving span [N]; torque of the shaft on the belt
        [N m]; speed of the pulley over ``v0`` [1/m], to reach points where the whole arc slides.
    start : RodState, optional
        A similar state of the same pulley, from which the iteration starts.

    Raises
    ------
    InputError
        If not exactly one of the three is given, or a force or speed is not positive.
    ConvergenceError
        If no steady state was found, for example at a torque that the friction cannot transmit.
    """
    given = [value is not None for value in (P_out, torque, W)]
    if sum(given) != 1 or not v0 > 0.0 or not P_in > 0.0 or (P_out is not None and not P_out > 0.0):
        raise InputError(
            "pulley: exactly one of P_out, torque and W, with v0, P_in and P_out > 0, must be given"
        )
    # if the sticking patches of the start are too far off: from soft patches, then from a belt laid
    # on without friction
    attempts = [(start, SOFTNESS[-1:]), (start, SOFTNESS), (None, SOFTNESS)]
    failure = ConvergenceError("")
    for begin, softness in attempts if start is not None else attempts[2:]:
        # float(): an int would recompile the kernel for another signature
        flow = _Running.begin(pulley, float(v0), float(P_in), begin)
        q, R = flow.kinematics.q, pulley.R
        levers = np.array([-q[1], q[0], -q[-3], q[-4]]) / R  # of the fixed supports
        if P_out is not None:
            target = Flow(flow.v0, True, levers, float(P_out), True)
        else:
            given_by_levers = float(torque or 0.0) / R
            target = Flow(flow.v0, False, levers, given_by_levers, torque is not None)
        try:
            if W is not None:
                flow.set_speed(float(W), target, ramp=begin is None)
            if flow.sheared:
                flow.find_sheared(target)
            else:
                flow.find_sticking(target, softness if W is None else SOFTNESS[-1:])
            return flow.state(levers)
        except ConvergenceError as error:
            failure = error
    raise failure


@dataclass(slots=True)
class _Running:
    """Search for a steady state: everything that the rounds of the iteration change."""

    pulley: RodPulley
    v0: float
    P_in: float
    system: System
    points: Points
    work: Workspace
    kinematics: Kinematics
    stretch: float
    omega: float
    switches: NDArray[np.int64]  # changes of every patch
    record: Steps = field(default_factory=lambda: schedule(math.inf, 0.0))
    patches: Any = field(init=False)  # fields of the patches of ``points``
    outcome: Any = field(init=False)  # fields of ``record``: last iteration, number of iterations

    def __post_init__(self) -> None:
        self.patches, self.outcome = fields_of(self.points.patches), fields_of(self.record)

    @property
    def sheared(self) -> bool:
        """Whether the ribs shear; there are then no patches."""
        return math.isfinite(self.points.ribs.stiffness)

    @classmethod
    def begin(cls, pulley: RodPulley, v0: float, P_in: float, start: RodState | None) -> _Running:
        """Start from a belt laid on without friction, or from a similar state."""
        model = pulley.model
        momentum = pulley.belt.rhoA * v0 * v0
        system = model.system._replace(belt=model.system.belt._replace(momentum=momentum))
        shears = ribs_shear(pulley)
        points = new_points(system.belt, STICK, pulley.shear_stiffness if shears else math.inf)
        work = model.workspace(borders=2 + MOST_ZONES if shears else 2)
        if start is not None:
            _overwrite(points.patches, start.points.patches)
            points.last["limit"][:] = start.points.last["limit"]
            state = start.contact.q, start.contact.stretch, start.W * v0
        else:
            T, EA, laid = pulley.tension, pulley.belt.EA, lay_on(model)
            longer = 1.0 + (T + momentum) / (EA - momentum)
            stretch = laid.stretch * (1.0 + T / EA) / longer
            rate = longer / (pulley.R - float(pulley.law.penetration(T / pulley.R)))
            state = laid.q, stretch, rate * v0
            opened = ~np.any(laid.points.F_N > 0.0, axis=1)
            ends = opened | preceding(opened) | following(opened)
            points.patches["status"][ends] = SLIDE
        switches = np.zeros(points.patches["status"].size, dtype=np.int64)
        q, stretch, omega = state
        kinematics = new_kinematics(q)
        return cls(pulley, v0, P_in, system, points, work, kinematics, stretch, omega, switches)

    def set_speed(self, W: float, target: Flow, *, ramp: bool) -> None:
        """Set the pulley speed; for a belt laid on, ramp up the friction of the sliding arc."""
        patches, frictionless = self.patches, self.omega
        self.omega = W * self.v0
        if not ramp or self.sheared:
            return
        patches.status[:] = SLIDE
        patches.sign[:] = math.copysign(1.0, self.omega - frictionless)
        for share in LAID:
            if not self._newton(target, 0.0, share):
                raise self._failure(1)

    def find_sticking(self, target: Flow, softness: tuple[float, ...]) -> None:
        """Find the sticking patches: soft ones first, which slide above their limit, then hard.

        A patch of a running belt sticks if the slip at its *upstream* end vanishes. The sticking
        patches hang on the slip front downstream of them, so their forces follow one after another,
        with a compliance matrix that is triangular and positive on its diagonal: a P-matrix.
        """
        patches, kept = self.patches, self._copy()
        typical = self.pulley.tension / self.pulley.R * float(np.median(self.system.belt.h))
        for soft in softness:
            augmentation = typical / (soft * self.v0)
            hard = soft == softness[-1]
            most, rounds = patches.status.size, 0
            self.switches[:] = 0
            while True:
                rounds += 1
                if rounds > MOST_ROUNDS:
                    raise self._failure(rounds)
                if not self._newton(target, augmentation):
                    if most == 1 or rounds == 1:
                        raise self._failure(rounds)
                    most //= 4  # too many changes at once: go back and allow fewer
                    self._restore(kept)
                elif hard:
                    sticking = patches.status == STICK
                    patches.la_T[sticking] = patches.force[sticking]
                self._unmark_reversals()
                kept = self._copy()
                most = max(most >> int(rounds > FREE_ROUNDS and rounds % PATIENCE == 0), 1)
                changes = self._change_sides(augmentation, hard, most)
                if changes == 0 and (
                    not hard or (self._sticks_without_slip() and not self._mark_reversals())
                ):
                    break

    def find_sheared(self, target: Flow) -> None:
        """Find the state of ribs that shear, via softer ribs if it is not found directly.

        Stiff ribs change between sticking and sliding within a fraction of an element: they need a
        start in which nearly the same points stick.
        """
        # friction that falls with the speed can have two states: more friction leads to that with
        # less slip
        frictions = (MORE_FRICTION, 1.0) if self.pulley.model.friction_falls else (1.0,)
        requested, solved, step = self.points.ribs.stiffness, 0.0, math.log(SOFTER)
        stiffness, rounds = requested, 0
        while step >= LEAST_STEP and stiffness >= requested / SOFTEST and rounds < MOST_WITH_SOFTER:
            rounds += 1
            kept = self.kinematics.q.copy(), self.stretch, self.omega
            ribs = self.points.ribs._replace(stiffness=stiffness)
            self.points = self.points._replace(ribs=ribs)
            if all(self._newton(target, 0.0, share) for share in frictions):
                if stiffness == requested:
                    return
                solved, step = stiffness, LONGER * step
            else:
                self.kinematics.q[:], self.stretch, self.omega = kept
                step = 0.5 * step if solved else step
            stiffness = solved * math.exp(step) if solved else stiffness / SOFTER
            # avoid a tiny last step
            stiffness = requested if stiffness > requested * math.exp(-0.3 * step) else stiffness
        hint = f"; one was found with ribs of {solved:.3g} instead of {requested:.3g} N/m²"
        raise self._failure(rounds, hint if solved else "")

    def _newton(self, target: Flow, augmentation: float, friction: float = 1.0) -> bool:
        given = Given(self.stretch, self.P_in, augmentation, 1.0, friction, False, target)
        self.outcome.omega[0] = self.omega
        run = self.system, self.points, self.kinematics, given, self.work, self.record
        converged = march(*run, 0, 1) == 1
        self.stretch, self.omega = float(self.outcome.stretch[0]), float(self.outcome.omega[0])
        return converged

    def _change_sides(self, augmentation: float, hard: bool, most: int) -> int:
        """Switch the first ``most`` patches that violate the law between stick and slide."""
        patches = self.patches
        sticking = patches.status == STICK
        holding = patches.la_T + augmentation * patches.slip
        backward = patches.sign * patches.slip < -SLIP_TOLERANCE * self.v0
        if hard:
            holding = np.where(sticking, patches.force, patches.sign * patches.limit)
            beyond = np.abs(holding) > patches.limit * (1.0 + 0.1 * CONE_TOLERANCE)
            changes = np.where(sticking, beyond, backward)
        else:
            slides = np.abs(holding) > patches.limit
            turned = slides & (np.sign(holding) != patches.sign)
            changes = np.where(sticking, slides, ~slides | turned)
            changes &= self.switches < MOST_SOFT_SWITCHES
        # a patch at an end of the contact carries no load: if it stuck, it would open and close.
        # If the sliding changes direction within such a patch, the patch keeps the last direction
        open_ = patches.limit == 0.0
        edge = np.any(self.points.F_max == 0.0, axis=1) | preceding(open_) | following(open_)
        changes = np.where(edge, sticking | (backward & (self.switches < MOST_SWITCHES)), changes)
        changes &= ~patches.turning
        holding = np.where(edge, patches.slip, holding)
        changed = np.flatnonzero(changes & (patches.limit > 0.0))[:most]
        direction = holding[changed]
        to_slide = sticking[changed] | edge[changed]  # before sliding backwards a patch sticks
        self.switches[changed] += 1
        patches.status[changed] = np.where(to_slide, SLIDE, STICK)
        # a patch closes with unseated ribs: the pulley is ahead of the belt
        patches.status[open_], patches.la_T[open_] = SLIDE, 0.0
        patches.sign[changed] = np.where(direction < 0.0, -1.0, 1.0)
        patches.sign[open_] = 1.0
        if hard:
            patches.la_T[changed] = patches.force[changed]
        return changed.size

    def _unmark_reversals(self) -> None:
        """Unmark the patches within which the sliding no longer changes direction."""
        patches = self.patches
        backward = patches.turning & (patches.sign * patches.slip < 0.0)
        patches.status[backward] = STICK
        patches.la_T[backward] = patches.force[backward]
        patches.turning[:] &= ~backward & (patches.sign * patches.slip_out < 0.0)

    def _mark_reversals(self) -> bool:
        """Mark the patches within which the sliding changes direction; return whether any are new.

        A single sticking patch between two that slide in opposite directions is one of them if
        friction could not hold the belt at its entry, (R6).
        """
        patches, flow = self.patches, self.v0 / self.system.belt.EA
        slides = (patches.status == SLIDE) & (patches.limit > 0.0)
        reverses = slides & (patches.sign * patches.slip_out < 0.0)
        sign, behind = preceding(patches.sign), following(patches.sign)
        alone = (patches.status == STICK) & preceding(slides) & following(slides)
        at_entry = sign * patches.force - sign * patches.slip_out / flow
        alone &= (sign * behind < 0.0) & (at_entry > patches.limit)
        edge = np.any(self.points.F_max == 0.0, axis=1)
        new = (reverses | alone) & ~edge & ~patches.turning
        patches.sign[alone & new] = sign[alone & new]
        patches.turning[new] = True
        patches.status[new] = SLIDE
        return bool(new.any())

    def _sticks_without_slip(self) -> bool:
        """Return whether no sticking patch slips."""
        patches = self.patches
        sticks = (patches.status == STICK) & (patches.limit > 0.0)
        slip = np.abs(patches.slip[sticks]).max(initial=0.0)
        return bool(slip <= SLIP_TOLERANCE * self.v0)

    def _copy(self) -> tuple[Array, float, float, Patches]:
        """Copy the state to restore after a failed round."""
        q = self.kinematics.q.copy()
        return q, self.stretch, self.omega, self.points.patches.copy()

    def _restore(self, kept: tuple[Array, float, float, Patches]) -> None:
        self.kinematics.q[:], self.stretch, self.omega = kept[:3]
        _overwrite(self.points.patches, kept[3])

    def _whole_slip(self) -> float:
        """Return the sliding speed behind the entry if no adhesion arc is left [m/s], else 0.

        A single sticking patch is no adhesion arc: one may stick where sliding changes direction.
        """
        entry = self.pulley.behind_entry
        if self.sheared:
            sticks = self.points.ribs.zone[entry:] != SLIDES
            return 0.0 if np.any(sticks) else abs(float(self.points.slip[entry, 0]))
        patches = self.patches
        sticks = (patches.status == STICK) & (patches.limit > 0.0)
        if np.any(sticks[1:] & sticks[:-1]):
            return 0.0
        # a slack belt may touch the pulley only behind the entry
        first = entry + int(np.argmax(patches.limit[entry:] > 0.0))
        return abs(float(patches.slip[first]))

    def _failure(self, rounds: int, hint: str = "") -> ConvergenceError:
        iterations, residual = int(self.outcome.iterations[0]), float(self.outcome.residual[0])
        return ConvergenceError(
            f"pulley of {1e3 * self.pulley.R:g} mm, {math.degrees(self.pulley.wrap):.4g} deg, belt "
            f"at {self.v0:g} m/s, {self.P_in:g} N: no steady running found in {rounds} rounds of "
            f"{iterations} Newton iterations (residual {residual:.2g}){hint}",
            iterations=iterations,
            residual=residual,
        )

    def state(self, levers: Array) -> RodState:
        """Collect the result."""
        record = self.record[0]
        points, force, R = self.points, self.work.reactions.force, self.pulley.R
        if self.sheared:
            sticks = points.ribs.zone != SLIDES
            certificate = certify(self.system.belt, points)
        else:
            sticks = (points.patches["status"] == STICK)[:, None] & (points.f_N > 0.0)
            values = record.slip, record.cone, record.sticking, record.touching
            certificate = Certificate(*map(float, values))
        contact = ContactState(
            model=self.pulley.model,
            stretch=self.stretch,
            support_force=force,
            q=self.kinematics.q,
            angle=points.theta,
            line_force=points.f_N,
            tangential_force=points.F_T,
            slip_speed=points.slip,
            sticks=sticks.astype(float),
        )
        return RodState(
            v0=self.v0,
            W=self.omega / self.v0,
            torque=float(levers @ force) * R,
            P_in=math.hypot(force[0], force[1]),
            P_out=math.hypot(force[2], force[3]),
            friction_power=float(np.sum(points.F_T * points.slip * points.rho)) / R,
            contact=contact,
            points=points,
            whole_slip=self._whole_slip(),
            certificate=certificate,
            residual=float(record.residual),
            iterations=int(record.iterations),
            outside=int(record.outside),
        )


def _overwrite(patches: Patches, others: Patches) -> None:
    patches[:] = others
