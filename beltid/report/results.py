"""Results of one belt as the report reads them: artifacts, settings of their runs, the verdict."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, Self

import numpy as np

from beltid.identify.estimators import settings_of as numbered_settings, snap_to_settings
from beltid.laws.penalty import NormalLaw
from beltid.report.summary import cell, sentence
from beltid.store.artifact import Artifact, combined_origin

HELD_OUT = "crossvalidation"  # comparison with runs that were left out and predicted
SURFACES = ("surface_refined", "surface")
SIMULATED = ("simulated_refined", "simulated")
COMPARED = ("compare_refined", "compare")
# artifact -> the surface that it is, or was simulated with; the refined one first
LABELS = {
    name: "refined" if name.endswith("refined") else "published"
    for name in (*SURFACES, *SIMULATED, *COMPARED)
}
LEFT_OUT = {"arc": "an arc", "speed": "a speed"}  # label of the setting that was left out
SAME = 0.03  # relative distance within which two values count as one setting
DISTINCT = 0.05  # relative distance beyond which two values count as evidence of their own
UNKNOWN = -1.0  # placeholder for an unknown setting
MOST_UNCERTAINTIES = 2.0  # largest RMS error, over u, at which predictions confirm a surface
WORDS = ("no", "one", "two", "three")
MOST_LISTED = 12  # largest number of settings that are listed; for more, the range is given


class Sheet(Artifact):
    """An artifact as the report reads it."""

    __slots__ = ()

    @classmethod
    def of(cls, artifact: Artifact) -> Self:
        """Read an artifact as a sheet."""
        return cls(artifact.columns, artifact.record, artifact.path, artifact.sha256)

    def __getitem__(self, column: str) -> np.ndarray:
        """Return a column of the table; all nan if the table does not have it."""
        return self.columns.get(column, np.full(len(next(iter(self.columns.values()))), np.nan))

    def rows(self, name: str) -> list[dict[str, Any]]:
        """Return a further table; empty if there is none."""
        return self.record.tables.get(name) or []

    @property
    def label(self) -> str:
        """What a surface or a comparison is, in words."""
        what = LABELS.get(self.name) or LEFT_OUT.get(self.facts.get("hold_out", ""), "runs")
        return f"{what} {'surface' if self.name in LABELS else 'left out and predicted'}"

    @property
    def rig(self) -> Mapping[str, Any]:
        """Section `rig` of the config with which it was made."""
        return self.record.settings.get("rig") or {}

    @property
    def pulley_radius_m(self) -> float:
        """Pulley radius of the rig used for this artifact [m]; nan if unknown."""
        return float(self.rig.get("pulley_radius_m") or np.nan)

    @property
    def mu_error(self) -> tuple[str, str]:
        """Column with the error of a surface, combined if it is known, and its name."""
        combined = "mu_u", "combined standard uncertainty"
        return combined if "mu_u" in self.columns else ("mu_se", "standard error")

    @property
    def surface(self) -> Any:
        """Averaged `FrictionSurface` with its errors."""
        from beltid.identify.surface.surface import surface_from_columns  # slow to import

        return surface_from_columns({**self.columns, "mu_se": self.columns[self.mu_error[0]]})

    @property
    def measured_force(self) -> Sequence[float] | None:
        """Lowest and highest mean force of the runs behind a surface [N/m]; None if not stated."""
        return (self.facts.get("measured") or {}).get("normal_force_N_m")

    @property
    def combined_percent(self) -> float | None:
        """Combined standard uncertainty of a surface in the measured range [%]; None if unknown."""
        rows = (row for row in self.rows("budget") if row["source"] == "combined")
        return next((row["contribution_percent"] for row in rows), None)

    @property
    def overall(self) -> Mapping[str, Any]:
        """Statistics over all points of a comparison."""
        return next(iter(self.rows("groups")), {})

    @property
    def too_few_compared(self) -> bool:
        """Whether a comparison failed only because it has too few runs."""
        missed = [row["tolerance"] for row in self.rows("judged") if not row["holds"]]
        return missed == ["min_share_compared"]

    @property
    def rms_percent(self) -> str:
        """RMS difference of a comparison, formatted."""
        return cell("rms_percent", self.overall.get("rms_percent"))

    @property
    def over_uncertainty(self) -> float | None:
        """RMS difference in standard uncertainties; None if these are unknown."""
        return (self.facts.get("validation") or {}).get("rms_e_over_u")

    @property
    def pooled_row(self) -> int:
        """Row of the pooled law of a stiffness table."""
        return int(np.flatnonzero(np.isnan(self.columns["temperature_degC"]))[0])

    def law(self, row: int) -> NormalLaw:
        """Return the normal law in a row of a stiffness table."""
        names = ("k_linear_N_m2", "k_quadratic_N_m3")
        return NormalLaw(*(float(self.columns[name][row]) for name in names))


@dataclass(frozen=True, slots=True, eq=False)
class BeltResults:
    """All results of one belt.

    Each of the `profiles`, of a typical run of each arc, has its arc_deg, initial_tension_N,
    slip_speed_m_s and mean_force_N_m by Eq. (8); and along the arc, as simulated, arc_position_m,
    normal_force_N_m and capstan_force_N_m.
    """

    belt: str
    sheets: Mapping[str, Sheet]  # available artifacts by name
    profiles: tuple[Mapping[str, Any], ...] = ()
    problems: tuple[str, ...] = ()  # artifacts that are missing, damaged or not shown
    failures: tuple[str, ...] = ()  # stages of the last `run` that failed
    belt_facts: tuple[str, ...] = ()  # type and ribs of the belt, if its config was found

    def get(self, *names: str) -> Sheet | None:
        """Return the first of some artifacts that there is; None if none."""
        return next((self.sheets[name] for name in names if name in self.sheets), None)

    def every(self, *names: str) -> list[Sheet]:
        """Return those of some artifacts that there are."""
        return [self.sheets[name] for name in names if name in self.sheets]

    @property
    def prediction(self) -> Sheet | None:
        """The comparison with runs that were left out and predicted."""
        sheet = self.get(HELD_OUT)
        return sheet if sheet and sheet.facts.get("hold_out") in LEFT_OUT else None

    @property
    def origin(self) -> str | None:
        """Origin of the data: "synthetic" if any are, "measured" if all are, else None."""
        return combined_origin([sheet.origin for sheet in self.sheets.values()])


def series_of(*columns: np.ndarray) -> dict[tuple[Any, ...], list[int]]:
    """Group the rows of some columns by their settings, in order of first appearance.

    The scatter of motors and weights makes no setting of its own; unknown ones count as -1.
    """
    settings = [
        of if of.dtype == object else np.nan_to_num(snap_to_settings(of), nan=UNKNOWN)
        for of in columns
    ]
    series: dict[tuple[Any, ...], list[int]] = {}
    for row, key in enumerate(zip(*(of.tolist() for of in settings), strict=True)):
        series.setdefault(key, []).append(row)
    return series


def settings_of(values: np.ndarray, most: int | None = None) -> list[np.ndarray]:
    """Group the rows of the runs by setting, ascending; one run each if values do not cluster.

    Runs without a value are left out. More than `most` settings are joined to so many classes.
    """
    order = np.argsort(values, kind="stable")
    order = order[np.isfinite(values[order])]
    labels = numbered_settings(values[order], SAME)
    if not all(is_setting(values[order[labels == label]]) for label in np.unique(labels)):
        labels = np.arange(order.size)
    numbers = np.unique(labels)
    parts = np.array_split(numbers, max(1, min(most or numbers.size, numbers.size)))
    return [order[np.isin(labels, part)] for part in parts if part.size]


def is_setting(values: np.ndarray) -> bool:
    """Return whether values are close enough to belong to one setting."""
    return bool(np.ptp(values) <= 2.0 * SAME * values.min())


def class_name(values: np.ndarray, unit: str = "") -> str:
    """Name the setting of some runs, or the range of their class."""
    if is_setting(values):  # exact, or scattered
        return f"{np.median(values):.{4 if np.ptp(values) == 0.0 else 3}g}{unit}"
    return f"{values.min():.3g} to {values.max():.3g}{unit}"


def load_name(friction: Sheet) -> str:
    """Return what sets the tension of the belt on the rig: a weight, or its tension at rest."""
    rig = f"{friction.rig.get('holds')} {friction.facts.get('rig_holds')}"
    return "weight" if "weight" in rig else "belt tension"


class Verdict(NamedTuple):
    """Whether the law is proven."""

    headline: str
    state: str  # "good", "bad" (out of tolerance) or "open"


def verdict_of(results: BeltResults) -> Verdict:
    """Judge the results of a belt."""
    compared, predicted = results.every(*COMPARED), results.prediction
    decisive, said = [*compared[:1], *([predicted] if predicted else [])], list[str]()
    if predicted:
        left_out, over_u = LEFT_OUT[predicted.facts["hold_out"]], predicted.over_uncertainty
        ratio = "" if over_u is None else f", {over_u:.2g} standard uncertainties"
        said.append(
            f"friction of {left_out} that was left out is predicted to {predicted.rms_percent} % "
            f"RMS{ratio} ({_within(predicted)})"
        )
    if compared:
        misses = [f"the {of.label} by {of.rms_percent} % RMS ({_within(of)})" for of in compared]
        said.append(f"the simulated rig misses the measured friction with {', with '.join(misses)}")
    start, state = "Identified and proven", "good"
    if not decisive:
        said = ["the simulated rig was not compared with the bench"]
        start, state = "Not proven", "open"
    elif not all(sheet.record.passed or sheet.too_few_compared for sheet in decisive):
        start, state = "Identified, but out of tolerance", "bad"
    elif missing := "; ".join(_missing_evidence(results)):
        start, state = f"Identified, not proven ({missing})", "open"
    headline = f"{start}: {'. '.join([said[0], *map(sentence, said[1:])])}."
    if results.failures:
        headline, state = f"Incomplete: {'; '.join(results.failures)}. {headline}", "bad"
    return Verdict(headline, state)


def _within(sheet: Sheet) -> str:
    if sheet.too_few_compared:
        count, of = sheet.overall.get("n_points"), sheet.facts.get("runs_measured")
        return f"only {cell('n', count)} of {cell('n', of)} runs compared"
    return f"{'within' if sheet.record.passed else 'out of'} tolerance"


def _missing_evidence(results: BeltResults) -> Iterator[str]:
    """Yield what prevents results that agree from counting as proven."""
    own, left_out = results.get("compare_refined"), results.prediction
    for sheet, without, misses in (
        (own, "no refined surface was compared", "the refined surface misses its own runs by"),
        (left_out, "no runs were left out and predicted", "the predictions miss by"),
    ):
        if sheet is None:
            yield without
        elif sheet.too_few_compared:
            yield _within(sheet)
        elif (sheet.over_uncertainty or 0.0) > MOST_UNCERTAINTIES:
            u = f"{sheet.over_uncertainty:.2g} of their standard uncertainties"
            yield f"{misses} {u}, at most {MOST_UNCERTAINTIES:g} allowed"
    if friction := results.get("friction"):
        for setting, column, enough in (
            ("contact arc", "arc_deg", 2),
            (load_name(friction), "nominal_tension_N", 3),  # they show the shape of the surface
            ("sliding speed", "slip_speed_m_s", 3),
        ):
            if (n := _distinct(np.abs(friction[column][friction["status"] == "ok"]))) < enough:
                yield f"{WORDS[n]} {setting}{'s' * (n != 1)}, {WORDS[enough]} are needed"


def _distinct(values: np.ndarray) -> int:
    """Count the values that differ by more than `DISTINCT`, in a grid or a random design."""
    found = [-1.0]
    for value in np.sort(values[np.isfinite(values)]).tolist():
        found += [value] if value > (1.0 + DISTINCT) * found[-1] else []
    return len(found) - 1


def main_results(results: BeltResults) -> dict[str, Any]:
    """Return the main results of a belt by name, those that there are."""
    row: dict[str, Any] = {"belt": results.belt, "data": results.origin}
    if stiffness := results.get("stiffness"):
        row |= {name: v[stiffness.pooled_row] for name, v in stiffness.columns.items()}
    if friction := results.get("friction"):
        row["runs_used"] = int(np.count_nonzero(friction["status"] == "ok"))
        row["runs_set_aside"] = friction["status"].size - row["runs_used"]
    if best := results.get(*SURFACES):
        nodes, mu = best.surface.normal_force_N_m, best.surface.mu_nodes
        row["mu_range"] = [float(mu.min()), float(mu.max())]
        row["measured_force_N_m"] = best.measured_force
        row["valid_force_N_m"] = [float(nodes[0]), float(nodes[-1])]
        row["mu_u_percent"] = best.combined_percent
    for sheet in results.every(HELD_OUT, *COMPARED):
        name, word = LABELS.get(sheet.name, "predicted"), "PASS" if sheet.record.passed else "FAIL"
        row[f"{name}_rms_percent"] = f"{word} {sheet.rms_percent}"
    if drive := results.get("compare_drive"):
        row["predicted_speed_loss"] = drive.record.verdict
    return row


def conditions(results: BeltResults) -> list[tuple[str, str]]:
    """List belt, rig, settings, temperatures and config, each with its value.

    Unknown values are left out. The settings are those of the measured runs, not those planned in a
    config.
    """
    lines = [("Belt", ", ".join([results.belt, *results.belt_facts]))]
    if friction := results.get("friction"):
        load = "Weights" if load_name(friction) == "weight" else "Belt tensions at rest T₀"
        lines += [
            ("Pulley radius", _settings(np.array([1e3 * friction.pulley_radius_m]), " mm")),
            ("Contact arcs", _settings(friction["arc_deg"], "°")),
            (load, _settings(friction["nominal_tension_N"], " N")),
            ("Sliding speeds v", _settings(1e3 * np.abs(friction["slip_speed_m_s"]), " mm/s")),
            ("Surface", _joined(friction.columns.get("condition", ()))),
            ("Side of the belt", _joined(friction.columns.get("side", ()))),
            ("Rig temperature", _settings(friction["temperature_degC"], " °C", 1)),
        ]
    if stiffness := results.get("stiffness"):
        length = (stiffness.record.settings.get("press") or {}).get("segment_length_cm")
        lines += [
            ("Press segment", f"{float(length):.4g} cm" if length else ""),
            ("Press temperatures", _settings(stiffness["temperature_degC"], " °C")),
        ]
    lines.append(("Config", _joined(sheet.record.config for sheet in results.sheets.values())))
    return [(name, value) for name, value in lines if value]


def _joined(texts: Iterable[str]) -> str:
    return ", ".join(sorted(set(filter(None, texts))))


def _settings(values: np.ndarray, unit: str, most: int | None = None) -> str:
    """List the settings of some runs, joined to so many classes."""
    names = [class_name(values[rows]) for rows in settings_of(values, most)]
    if len(names) > MOST_LISTED:
        names = [f"{len(names)} from {names[0]} to {names[-1]}"]
    return ", ".join(names) + unit if names else ""
