"""Contact stiffness from a compression press: the quadratic normal law, Eq. (3), as a mixed model.

A segment of belt is pressed into a grooved plate and released. The curve midway between the
branches of test j, in contact from p_j on, is

    f(x) = (1 + v_j + theta (T_j - T_ref)) F(y) + b(y) + c_j + e,      y = x - p_j,
    F(y) = k_linear y + k_quadratic y²,

with free contact points p_j. Random effects, of sizes that the data tell: v_j of the belt segment;
the slope theta over the temperature; the misfit b of the law, a smooth process that all tests
share; e, white and correlated along the curve. Of known size are the zero c_j of the load cell,
what reversals of the crosshead may add and, of a belt never unloaded, half the loop.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from beltid.arrays import Array
from beltid.errors import NumericsError
from beltid.identify.estimators import difference_sigma
from beltid.identify.press.recording import (
    PressCurve,
    PressRecording,
    StiffnessSettings,
    read_recording,
)
from beltid.laws.penalty import NormalLaw
from beltid.mixed import Mixed, Own, Posterior, Shared, Size, relinearised

Sizes = Mapping[str, float]

PRIORS = {
    "correlated": Size(3e-6, 2.0, 0.3),
    "segment": Size(1e-4, 2.0, 0.3),
    "temperature": Size(3e-3, 2.0, 0.3),
    "misfit": Size(3e-6, 2.0, 0.3),
}
"""Of the sizes, as shares of the force (segment, temperature per 50 K) or of its largest."""
REVERSAL = Size(1.0)  # of the part of the missing width of the loop that is due to a reversal
LOOP = Size(0.1)  # half the loop of a belt that was never unloaded, over the force: half of 20 %
DEPTH_M, LINE_FORCE_N_M = (2.0e-6, 5.0e-3), (1.0e2, 1.0e6)  # ranges for belt ribs
REACH = 0.3  # travel over which that part may vary, over the deepest penetration
CORRELATION, SMOOTH = 0.05, 0.15  # lengths of noise and misfit, over the deepest penetration
KNOTS = np.linspace(0.0, 1.0, 12)  # where its values are unknowns
PER_KELVIN = 1.0 / 50.0
ROUNDING = 1e-6  # of a force, over the largest
LARGEST_MISFIT = 0.1  # of a law with a coefficient at zero, over the largest force
LEAST_FORCE = 0.1  # share of the largest force from which on relative misfits count
SAME_TEMPERATURE_K = 3.0  # width of the range that counts as one nominal temperature
RELEVANT = 5.0e-3  # share of the force below which an effect does not matter
CLEAR = 2.6  # standard errors beyond which a slope is significant


@dataclass(frozen=True, slots=True)
class LawEstimate:
    """Normal law with its uncertainty, per metre of belt: one row of the stiffness table."""

    temperature_degC: float | None  # mean of the tests; None for the pooled law
    k_linear_N_m2: float  # coefficients of Eq. (3)
    k_quadratic_N_m3: float
    k_linear_se_N_m2: float  # their standard errors
    k_quadratic_se_N_m3: float
    covariance: tuple[float, ...]  # of both coefficients, row by row
    temperature_slope: tuple[float, float]  # relative change of the force per K, standard error
    sizes: dict[str, float]  # of the random effects: shares of the force or of its largest
    contact_offset_mm: float  # mean crosshead travel at the contact point
    rms_residual_N_m: float  # measured force minus law, both branches; mostly hysteresis
    hysteresis_ratio: float  # work lost in the loop over that of loading; nan if never unloaded
    max_penetration_m: float  # largest penetration and force: range of validity
    max_force_N_m: float
    n_samples: int  # within the range of the fit
    n_effective: float  # number of independent nodes behind the standard errors
    n_cycles: int
    contact_m: dict[str, float]  # position of the contact point of every test
    misfit: float  # largest misfit of the law over the force, from a tenth of it on
    notes: tuple[str, ...]
    warnings: tuple[str, ...]

    @property
    def law(self) -> NormalLaw:
        """Normal law of Eq. (3)."""
        return NormalLaw(self.k_linear_N_m2, self.k_quadratic_N_m3)


class _Scaled:
    """Nodes of the curves (R, m) over span and largest force; coefficients `held` at zero."""

    def __init__(self, curves: Sequence[PressCurve], reference_degC: float) -> None:
        self.span = max(c.top_position_m - c.touch_m for c in curves)
        self.top = top = max(c.top_force_N_m for c in curves)
        self.used = _padded([np.ones(c.position_m.size) for c in curves])  # 0 for padding
        # positions from where the force begins: numbers of order one
        self.x = _padded([(c.position_m - c.touch_m) / self.span for c in curves])
        self.f = _padded([c.middle_N_m / top for c in curves])
        self.turn = _padded([c.turn_N_m / top for c in curves])  # what a reversal may add
        self.zero = np.array([[c.zero_u_N_m / top] for c in curves])  # uncertainties (R, 1)
        warmer = np.array([[c.temperature_degC - reference_degC] for c in curves])
        self.warmer = PER_KELVIN * np.nan_to_num(warmer)  # (T - T_ref)/50 K, (R, 1)
        noise = np.median([difference_sigma(c.middle_N_m, 3) for c in curves]) / top
        self.noise = Size(max(float(noise), ROUNDING), 0.7, 0.3)  # of a node
        self.unloads = curves[0].unloads
        self.held = np.zeros(2, dtype=bool)

    def start(self) -> tuple[Array, Array]:
        """Return k and contact points from a parabola through every curve (closed form)."""
        parabolas = [
            np.polynomial.Polynomial.fit(x[u > 0], f[u > 0], 2).convert().coef
            for x, f, u in zip(self.x, self.f, self.used, strict=True)
        ]
        a, b, c = np.median(parabolas, axis=0)
        k = np.array([math.sqrt(max(b * b - 4.0 * a * c, 0.0)), c])
        if c <= 0.0:
            k = np.array([max(float(np.polyfit(self.x.ravel(), self.f.ravel(), 1)[0]), 1e-6), 0.0])
        root = np.sqrt(k[0] ** 2 + 4.0 * k[1] * np.maximum(self.f, 0.0))
        y = 2.0 * np.maximum(self.f, 0.0) / np.maximum(k[0] + root, 1e-9)
        return k, np.sum((self.x - y) * self.used, axis=1) / self.used.sum(axis=1)

    def design(self, k: Array, p: Array) -> tuple[Array, Array, Array]:
        """Return penetrations, forces (R, m) and derivatives; none by what is held."""
        y = np.maximum(self.x - p[:, None], 0.0)
        terms = np.stack([y, y**2], axis=-1)
        slope = -(k[0] + 2.0 * k[1] * y)[..., None] * np.eye(len(p))[:, None, :]
        columns = np.concatenate([terms * ~self.held, slope], axis=-1) * self.used[..., None]
        return y, terms @ k, columns

    def misfit(self, y: Array, columns: Array) -> Array:
        """Return columns of the misfit (R, m, 12): what the law itself cannot take up of it."""
        amplitude = np.sqrt(np.maximum(self.f, 0.0)) * self.used
        smooth = amplitude[..., None] * _smooth(y / np.max(y * self.used))
        T, flat = columns.reshape(-1, columns.shape[-1]), smooth.reshape(-1, KNOTS.size)
        return (flat - T @ np.linalg.lstsq(T, flat, rcond=1e-12)[0]).reshape(smooth.shape)

    def model(self, q: Array, known: Sizes, y0: Array, misfit: Array) -> Mixed:
        """Linearise the model about q = (k, p); the random effects are those at penetrations y0."""
        size = {"noise": self.noise, **PRIORS, **{name: Size(s) for name, s in known.items()}}
        used, s = self.used, y0 / np.max(y0 * self.used)
        _, F, columns = self.design(q[:2], q[2:])
        fixed = np.diag(np.pad(1.0 * self.held, (0, q.size - 2)))  # what has no column, at zero
        shared = [
            Shared("law", columns, precision=fixed),
            Shared("misfit", misfit, size["misfit"]),
        ]
        if np.any(self.warmer):
            shared.append(Shared("temperature", F * self.warmer * used, size["temperature"]))
        if not self.unloads:
            loop = np.stack([F, np.max(F) * s * (1.0 - s)], axis=-1) * used[..., None]
            shared.append(Shared("loop", loop, LOOP))
        elif np.any(self.turn):
            turn = np.stack([self.turn, self.turn * (1.0 - s) / REACH], axis=-1)
            shared.append(Shared("reversal", turn, REVERSAL))
        near = np.exp(-np.abs(s[:, :, None] - s[:, None, :]) / CORRELATION)
        near *= used[:, :, None] * used[:, None, :]
        own = [
            Own("noise", size["noise"], diagonal=used),
            Own("correlated", size["correlated"], covariance=near),
            Own("segment", size["segment"], columns=F * used),
            Own("zero", Size(1.0), columns=self.zero * used),
            Own("rounding", Size(ROUNDING), diagonal=used),
        ]
        return Mixed((self.f - F) * used, shared, own)


def _padded(rows: Sequence[Array]) -> Array:
    """Return rows of equal length, with zeros at their ends."""
    m = max(row.size for row in rows)
    return np.array([np.pad(row, (0, m - row.size)) for row in rows])


def _smooth(s: Array) -> Array:
    """Return columns of a process with covariance exp(-(s - s')²/(2 l²)), shape (..., 12)."""
    of_knots, of_s = (np.exp(-0.5 * ((a[..., None] - KNOTS) / SMOOTH) ** 2) for a in (KNOTS, s))
    L = np.linalg.cholesky(of_knots + 1e-9 * np.eye(KNOTS.size))
    return np.asarray(np.linalg.solve(L, of_s[..., None])[..., 0])


def fit_law(
    curves: Sequence[PressCurve],
    reference_degC: float = math.nan,
    known: Sizes | None = None,
    temperature_degC: float | None = None,
) -> LawEstimate:
    """Fit the law to curves of one bench, at a reference temperature [°C] (nan: none is sought).

    Sizes of effects may be `known` from more curves of the bench; `temperature_degC` is the mean of
    the curves, None for a pooled law. Raises `NumericsError` if the force does not rise or does not
    follow Eq. (3) with coefficients >= 0, and `NumericsError` if the fit does not converge.
    """
    data = _Scaled(curves, reference_degC)
    start, contact = data.start()
    data.held = start <= 0.0
    _held_note(data, start, contact)  # refused before the noise of such a fit is looked for
    k, p, posterior = _mode(data, start, contact, known or {})
    if np.any(k < 0.0):
        data.held = data.held | (k < 0.0)
        if data.held.all():
            raise NumericsError("the force falls with penetration, must rise")
        k, p, posterior = _mode(data, np.where(data.held, 0.0, start), contact, known or {})
    unit, free = data.top / data.span ** np.array([1.0, 2.0]), ~data.held
    place, F = posterior.model.places["misfit"], data.design(k, p)[1]
    off = np.abs(posterior.model.X[..., place] @ posterior.mean[place])
    high = (LEAST_FORCE * np.max(F * data.used) <= F) & (data.used > 0.0)
    misfit = float(np.max(off[high] / F[high]))
    covariance = posterior.covariance[:2, :2] * np.outer(free, free)
    if data.held.any():
        covariance[data.held, data.held] = _se_of_held(data, k, p, posterior) ** 2
    none = np.zeros(1), np.zeros(1)
    warming = posterior.of("temperature") if np.any(data.warmer) else none
    slope, variance = (float(x.item()) for x in warming)
    white = posterior.sizes["noise"] ** 2
    share = white / (white + posterior.sizes["correlated"] ** 2 / CORRELATION / data.x.shape[1])
    law = NormalLaw(*(k * unit).tolist())
    contact = p * data.span + [c.touch_m for c in curves]
    squares = [
        np.mean((force - law.force(position - at)) ** 2)
        for c, at in zip(curves, contact, strict=True)
        for position, force in c.fitted
    ]
    covariance = (covariance + misfit**2 * np.outer(k, k)) * np.outer(unit, unit)
    work = np.sum([c.work_J_m for c in curves if c.unloads], axis=0)
    loss = max(float(work[0] / work[1]), 0.0) if data.unloads else math.nan
    depth = float(np.max([c.top_position_m for c in curves] - contact))
    top = max(c.top_force_N_m for c in curves)
    held, segment = _held_note(data, k, p), posterior.sizes["segment"]
    notes, warnings = _findings(depth, top, data.unloads, misfit, held, segment)
    return LawEstimate(
        temperature_degC=temperature_degC,
        k_linear_N_m2=law.k_linear_N_m2,
        k_quadratic_N_m3=law.k_quadratic_N_m3,
        k_linear_se_N_m2=math.sqrt(covariance[0, 0]),
        k_quadratic_se_N_m3=math.sqrt(covariance[1, 1]),
        covariance=tuple(covariance.ravel().tolist()),
        temperature_slope=(PER_KELVIN * slope, PER_KELVIN * math.sqrt(variance)),
        sizes=posterior.sizes,
        contact_offset_mm=float(np.mean([c.travel_sign for c in curves] * contact)) * 1e3,
        rms_residual_N_m=float(np.sqrt(np.mean(squares))),
        hysteresis_ratio=loss,
        max_penetration_m=depth,
        max_force_N_m=top,
        n_samples=sum(branch.shape[1] for c in curves for branch in c.fitted),
        n_effective=float(data.used.sum()) * share,
        n_cycles=len(curves),
        contact_m=dict(zip((c.test for c in curves), contact.tolist(), strict=True)),
        misfit=misfit,
        notes=notes,
        warnings=warnings,
    )


def _mode(data: _Scaled, k: Array, p: Array, known: Sizes) -> tuple[Array, Array, Posterior]:
    """Return coefficients (zero if held), contact points and the posterior."""
    y, _, columns = data.design(k, p)
    misfit = data.misfit(y, columns)
    q, posterior = relinearised(lambda q: data.model(q, known, y, misfit), np.append(k, p))
    return q[:2], q[2:], posterior


def _se_of_held(data: _Scaled, k: Array, p: Array, posterior: Posterior) -> float:
    """Return the standard error of a coefficient that is held at zero, were it free."""
    model, y = posterior.model, np.maximum(data.x - p[:, None], 0.0)
    column = y**2 if data.held[1] else np.ones(y.shape)
    shared = [*model.shared, Shared("held", column * data.used)]
    se = math.sqrt(Mixed(model.y, shared, model.own).at(posterior.sizes).of("held")[1][0, 0])
    return se if data.held[1] else math.sqrt(4.0 * float(k[1]) * se)


def _held_note(data: _Scaled, k: Array, p: Array) -> str:
    """Say which coefficient is held at zero, if any; refuse a law that misses by far."""
    if not data.held.any():
        return ""
    largest = float(np.max(np.abs((data.f - data.design(k, p)[1]) * data.used)))
    name, form = ("k_linear", "purely quadratic") if data.held[0] else ("k_quadratic", "linear")
    text = (
        f"{name} would be negative and is held at zero: a {form} law, off by up to "
        f"{100 * largest:.2g} % of the largest force"
    )
    if largest > LARGEST_MISFIT:
        raise NumericsError(
            f"{text}, must be <= {100 * LARGEST_MISFIT:g} %: the curve does not follow a law "
            "k_linear delta + k_quadratic delta² that stiffens from a contact point"
        )
    return text


@dataclass(frozen=True, slots=True)
class StiffnessResult:
    """Results of a press recording."""

    laws: tuple[LawEstimate, ...]  # one per known temperature, ascending
    pooled: LawEstimate  # law at the reference temperature, from all tests
    temperature_matters: bool | None  # significant and relevant; None if not tested
    quadratic_supported: bool  # whether the law, with both terms, is all that the curves show
    recording: PressRecording  # curves used for the fits, and rejected tests
    notes: tuple[str, ...]  # for the user, without the warnings of the pooled law


def fit_stiffness(press: Mapping[str, NDArray], settings: StiffnessSettings) -> StiffnessResult:
    """Identify the quadratic normal law from a press recording, see :func:`read_recording`.

    Raises `InputError` if no test can be used, and `NumericsError` if no law with ``k >= 0``
    describes the curves, or the fit does not converge.
    """
    recording = read_recording(press, settings)
    groups = _group_by_temperature(recording.curves)
    reference = settings.reference_temperature_degC if len(groups) > 1 else math.nan
    pooled = fit_law(recording.curves, reference)
    laws, notes = [], []
    for t, curves in groups.items():
        try:
            laws.append(fit_law(curves, known=pooled.sizes, temperature_degC=t))
        except NumericsError as error:
            notes.append(f"No law of the tests at {t:g} °C alone: {error}.")
    matters, statement = _temperature_effect(groups, *pooled.temperature_slope)
    coefficients = pooled.k_linear_N_m2, pooled.k_quadratic_N_m3
    supported = pooled.misfit < RELEVANT and min(coefficients) > 0.0
    notes += [
        statement,
        f"The quadratic law is {'' if supported else 'not '}supported: it misses by up to "
        f"{100 * pooled.misfit:.2g} % of the force beyond a tenth of its largest value.",
        *pooled.notes,
        *recording.notes,
    ]
    return StiffnessResult(tuple(laws), pooled, matters, supported, recording, tuple(notes))


def _group_by_temperature(curves: Sequence[PressCurve]) -> dict[float, list[PressCurve]]:
    """Group the curves by nominal temperature, ascending; ignore unknown temperatures."""
    groups = list[list[PressCurve]]()
    known = [c for c in curves if math.isfinite(c.temperature_degC)]
    for curve in sorted(known, key=lambda c: c.temperature_degC):
        lowest = groups[-1][0].temperature_degC if groups else -math.inf
        if curve.temperature_degC - lowest >= SAME_TEMPERATURE_K:
            groups.append([])
        groups[-1].append(curve)
    return {round(float(np.mean([c.temperature_degC for c in g])), 1): g for g in groups}


def _temperature_effect(
    groups: Mapping[float, Sequence[PressCurve]], slope: float, se: float
) -> tuple[bool | None, str]:
    """Judge the slope of the force over the temperature; return the result in plain words, too."""
    if len(groups) < 2:
        where = "".join(f"{t:g} °C" for t in groups) or "an unknown temperature"
        return None, f"All tests are at {where}: no statement on temperature."
    low, high = min(groups), max(groups)
    change, u = 100.0 * slope * (high - low), 100.0 * se * (high - low)
    matters = abs(slope) > CLEAR * se and abs(change) > 100.0 * RELEVANT
    return matters, (
        f"Temperature {'matters' if matters else 'does not matter'} between {low:g} and {high:g} "
        f"°C: the force changes by {change:.2g} ± {u:.1g} %."
    )


def _findings(
    depth: float, top: float, unloads: bool, misfit: float, held: str, segment: float
) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """Return notes and warnings of a law up to a penetration [m] and a line force [N/m]."""
    notes, included = list[str](), "included in the standard errors"
    warnings = [
        f"the belt {verb} by {found:.2g} {unit}, expected range {low:g} to {high:g} {unit}: is "
        f"{name} in another unit, or press.segment_length_cm wrong?"
        for name, verb, found, (low, high), unit in (
            ("displacement_mm", "penetrates", depth, DEPTH_M, "m"),
            ("force_N", "is pressed", top, LINE_FORCE_N_M, "N/m"),
        )
        if not low <= found <= high
    ]
    if misfit >= RELEVANT:
        warnings.append(f"the law misses by up to {100 * misfit:.2g} % of the force; {included}")
    if not unloads:
        warnings.append(
            "never unloaded: the law is that of the loading branch, which lies above the middle of "
            f"the branches; half of a loop of 20 % is {included}"
        )
    if held:
        (warnings if misfit >= RELEVANT else notes).append(held)
    if segment >= RELEVANT:
        notes.append(f"the tests differ by {100 * segment:.2g} % of the force; {included}")
    return tuple(notes), tuple(warnings)
