"""Parametric friction laws fitted to the surface with its covariance.

Every law is ``mu = (f/f0)^(-a) sum_k c_k phi_k(v; v*)`` (:mod:`beltid.laws.friction_formulas`). The
misfits at the nodes are one mixed model (:mod:`beltid.mixed`),

    ln mu - ln law(p) = errors of the nodes + error of the law + scatter,    p ~ N(p_0, s_0²),

with the known covariance of the nodes, an error of the law that is correlated between nodes, and
independent scatter; wide priors hold what the nodes do not show. The laws are ranked by evidence.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import block_diag

from beltid.arrays import Array
from beltid.errors import InputError, NumericsError
from beltid.identify.estimators import settings_of
from beltid.identify.surface.surface import SPEED_GAP
from beltid.laws.friction_formulas import FRICTION_LAWS, FrictionLaw
from beltid.mixed import Mixed, Own, Shared, Size, relinearised

FORCE_SPREAD = 0.05  # relative; forces in a narrower range do not determine an exponent
SCAN = 25  # speed scales of the scan for a first guess
LAW_ERROR = Size(3e-3, 2.0, largest=1.0)
SCATTER = Size(1e-3, 3.0, largest=1.0)
NO_LAW = 0.1  # error of a law above which it is not recommended
AS_GOOD = 2.0  # difference of the criterion that does not count
DETERMINED = 0.5  # standard error over the width of the prior, beyond which nothing is determined
STEPS, TURNS = 60, 10  # of the search; a law that takes more is not determined by the points


class FrictionParameter(NamedTuple):
    """A parameter of a friction law; its error is infinite if the data do not determine it."""

    name: str
    unit: str  # empty if dimensionless
    value: float
    se: float


@dataclass(frozen=True, slots=True, eq=False)
class FrictionLawFit:
    """Fit of one parametric law to the points of a surface."""

    law: str  # see :data:`beltid.laws.friction_formulas.FRICTION_LAWS`
    formula: str  # with the fitted parameters, as plain text; f in N/m, v in m/s
    parameters: tuple[FrictionParameter, ...]
    rms_misfit: float  # root mean square of the relative misfits ``law/mu - 1`` [-]
    worst_misfit: float  # the largest of them, with its sign [-]
    law_error: float  # standard deviation of law and scatter beyond the errors of the points [-]
    criterion: float  # -2 ln evidence, less that of the best law [-]

    @property
    def misses(self) -> str:
        """The misfit in words."""
        return f"{100 * self.rms_misfit:.2g} % RMS, {100 * abs(self.worst_misfit):.2g} % at worst"


@dataclass(frozen=True, slots=True, eq=False)
class FrictionLaws:
    """Parametric laws of a friction surface, in order of increasing complexity."""

    fits: tuple[FrictionLawFit, ...]
    notes: tuple[str, ...] = ()  # laws that could not be fitted

    @property
    def best(self) -> FrictionLawFit:
        """Fit with the largest evidence."""
        return min(self.fits, key=lambda fit: fit.criterion)

    @property
    def verdict(self) -> str:
        """The recommended formula in plain words; none if all fit poorly."""
        best, coulomb = self.best, self.fits[0]
        if all(fit.law_error > NO_LAW for fit in self.fits):
            closest = min(self.fits, key=lambda fit: fit.rms_misfit)
            return (
                "None of the fitted formulas holds over the whole range: the closest, "
                f"{closest.law}, misses by {closest.misses}; take the surface itself, or a part of "
                "the range."
            )
        text = (
            f"Best formula: {best.law}, {best.formula} (f in N/m, v in m/s), misfit {best.misses}"
        )
        if any(math.isinf(p.se) for p in best.parameters):
            text += "; not all of its parameters are determined: use it within the measured range"
        if equal := [f.law for f in self.fits if f is not best and f.criterion < AS_GOOD]:
            text += f"; {', '.join(equal)} {'does' if len(equal) == 1 else 'do'} as well"
        if best is not coulomb:
            text += f". A constant coefficient misses by {coulomb.misses}"
        return text + "."


def fit_friction_laws(
    normal_force_N_m: ArrayLike,
    slip_speed_m_s: ArrayLike,
    mu: ArrayLike,
    factor: ArrayLike | None = None,
) -> FrictionLaws:
    """Fit the parametric friction laws to points: f [N/m], v [m/s] and mu [-], (n,) each.

    The covariance of ln mu is S S' with the factor S (n, r); zero by default. The reference force
    f0 is the geometric mean of the forces, rounded to two digits, so that mu0 and a are nearly
    uncorrelated. Raises `InputError` for fewer than two points or a value not > 0, `NumericsError`
    if no law could be fitted.
    """
    f, v, mu = (np.asarray(x, dtype=float).ravel() for x in (normal_force_N_m, slip_speed_m_s, mu))
    if f.size < 2 or not all(np.all((x > 0.0) & (x < np.inf)) for x in (f, v, mu)):
        raise InputError("friction laws: at least 2 points with numbers > 0 are needed")
    fits, notes, speeds = [], [], int(settings_of(v, SPEED_GAP).max()) + 1
    one_force = f.max() <= (1.0 + FORCE_SPREAD) * f.min()
    for law in FRICTION_LAWS.values():
        few = f.size < len(law.parameters) or speeds < law.speeds_needed
        if not (few or ("a" in law.parameters and one_force)):
            try:
                fits.append(_fitted(law, f, v, mu, factor))
            except (NumericsError, np.linalg.LinAlgError) as error:
                notes.append(f"{law.name}: {error}")
    if not fits:
        raise NumericsError(notes)
    best = min(fit.criterion for fit in fits)
    ranked = (replace(fit, criterion=fit.criterion - best) for fit in fits)
    return FrictionLaws(tuple(ranked), tuple(notes))


def _fitted(
    law: FrictionLaw, f: Array, v: Array, mu: Array, factor: ArrayLike | None
) -> FrictionLawFit:
    """Fit one law; its criterion is not yet relative to others."""
    # the geometric mean of the forces, to two digits
    f0 = float(f"{np.exp(np.mean(np.log(f))):.2g}")
    at = [k for k, name in enumerate(law.parameters) if name == law.scale]
    # mean and standard deviation of the parameters; of a speed scale, of its logarithm
    level, log_v = float(np.mean(mu)), np.log(v)
    priors = {"a": (0.0, 1.0), "b": (0.0, 4.0), "c": (0.0, 2.0 * level / float(v.max()))}
    priors[law.scale or "scale"] = float(np.mean(log_v)), math.log(10.0) + float(np.ptp(log_v))
    before, width = np.array([priors.get(name, (level, level)) for name in law.parameters]).T
    S = np.zeros((f.size, 1)) if factor is None else np.asarray(factor, dtype=float)
    x, k = np.column_stack([np.log(f), log_v]), before.size
    near = np.exp(-np.linalg.norm(x[:, None] - x, axis=-1))
    own = [
        Own("law", LAW_ERROR, covariance=block_diag(near, np.zeros((k, k)))),
        Own("scatter", SCATTER, diagonal=np.repeat([1.0, 0.0], [f.size, k])),
        Own("known", Size(1.0), covariance=block_diag(S @ S.T, np.eye(k))),
    ]

    def parameters(t: Array) -> Array:
        p = before + width * t
        p[at] = np.exp(p[at])
        return p

    def model(t: Array) -> Mixed:
        p = parameters(t)
        value = law.mu(p, f / f0, v)
        J = law.gradient(p, f / f0, v) / value[:, None]
        J[:, at] *= p[at]
        with np.errstate(invalid="ignore", divide="ignore"):  # a step too far is halved
            misfit = np.log(mu / value)
        # the prior, as further data
        data = Shared("law", np.vstack([J * width, np.eye(k)]))
        return Mixed(np.append(misfit, -t), [data], own)

    q = _first_guess(law, f / f0, v, mu)
    q[at] = np.log(q[at])
    t, posterior = relinearised(model, np.clip((q - before) / width, -3.0, 3.0), STEPS, TURNS)
    p, se = parameters(t), width * np.sqrt(np.diag(posterior.covariance))
    se[~(se <= DETERMINED * width)] = np.inf
    se[at] *= p[at]
    found = zip(law.parameters.items(), p.tolist(), se.tolist(), strict=True)
    misfit = law.mu(p, f / f0, v) / mu - 1.0
    return FrictionLawFit(
        law=law.name,
        formula=law.text(p.tolist(), f0),
        parameters=tuple(FrictionParameter(*unit, value, error) for unit, value, error in found),
        rms_misfit=float(np.sqrt(np.mean(np.square(misfit)))),
        worst_misfit=float(misfit[np.argmax(np.abs(misfit))]),
        law_error=math.hypot(posterior.sizes["law"], posterior.sizes["scatter"]),
        criterion=-2.0 * posterior.log_evidence,
    )


def _first_guess(law: FrictionLaw, f: Array, v: Array, mu: Array) -> Array:
    """Return the parameters of least squares over speed scales, the exponent about zero."""
    scales = np.geomspace(0.1 * v.min(), 10.0 * v.max(), SCAN) if law.scale else np.ones(1)
    found = []
    for scale in scales:
        columns = law.terms(v, float(scale)) / mu[:, None]
        n_terms = columns.shape[1]
        if "a" in law.parameters:
            columns = np.column_stack([columns, -np.log(f)])
        c: Array = np.asarray(np.linalg.lstsq(columns, np.ones(f.size), rcond=1e-9)[0], float)
        p = law.from_amplitudes(c[:n_terms], float(c[n_terms:].sum()), float(scale))
        found.append((float(np.sum((columns @ c - 1.0) ** 2)), p))
    return min(found, key=lambda entry: entry[0])[1]
