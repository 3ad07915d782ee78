"""beltid export: write the contact law of a belt as a law file and for multibody codes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from beltid.errors import InputError
from beltid.export.law import ContactLaw
from beltid.export.reduction import reference_point
from beltid.export.targets import TARGETS, Export, export
from beltid.report.summary import Summary
from beltid.stages.inputs import load_law
from beltid.stages.law_of_belt import law_of_folder
from beltid.store.disk import write_bytes
from beltid.store.place import anyone_s, check_place

ALL: Final = "all"


def run(
    target: str | None,
    source: Path | None,
    config: Path | None,
    out: Path | None,
    *,
    force: bool = False,
    surface: str | None = None,
    normal_force_N_m: float | None = None,
    slip_speed_m_s: float | None = None,
) -> Summary:
    """Write the law of a results folder or of a law file for one target or for all."""
    if target is None:
        return _listed()
    if source is None:
        raise InputError(
            "LAW is missing: name the results of a belt, such as runs/5pk, or a law file"
        )
    targets = _targets(target)
    law = (
        _load_law_file(source, surface)
        if source.is_file()
        else law_of_folder(source, config, surface)
    )
    folder = out or (source if source.is_dir() else source.parent) / "export"
    point = reference_point(law, normal_force_N_m, slip_speed_m_s)
    exports = {name: export(law, name, point) for name in targets}
    up_to_date = _write(folder, exports.values(), source, force=force)
    return _summary(law, folder, exports, up_to_date)


def _load_law_file(source: Path, surface: str | None) -> ContactLaw:
    """Load the law of a law file, which holds one surface only."""
    law = load_law(source)
    if surface not in (None, law.friction.method):
        raise InputError(
            f"{source}: holds the {law.friction.method} surface, not the {surface} one; name the "
            "folder of the results"
        )
    return law


def _listed() -> Summary:
    """List the targets: name, output, and how much of the law it holds."""
    rows = [
        {"target": name, "writes": target.title, "holds": target.holds}
        for name, target in TARGETS.items()
    ]
    return Summary("export", "targets", table=rows, shown=("target", "writes"))


def _targets(name: str) -> Sequence[str]:
    if name == ALL:
        return tuple(TARGETS)
    if name not in TARGETS:
        allowed = ", ".join((*TARGETS, ALL))
        raise InputError(f"target = {name}, must be one of {allowed}")
    return (name,)


def _write(folder: Path, exports: Any, source: Path, *, force: bool) -> bool:
    """Write the files; return whether all of them already existed with this content."""
    files = {folder / name: data for export in exports for name, data in export.files.items()}
    problems, changed = list[str](), {}
    for path, data in files.items():
        if path.is_file() and path.read_bytes() == data:
            continue
        changed[path] = data
        try:
            law = {"law file that is read": source} if source.is_file() else {}
            check_place(path, (path.suffix,), anyone_s, inputs=law, force=force)
        except InputError as error:
            problems += error.problems
    if problems:
        raise InputError(problems)
    for path, data in changed.items():
        write_bytes(path, data)
    return not changed


def _summary(
    law: ContactLaw,
    folder: Path,
    exports: dict[str, Export],
    up_to_date: bool,
) -> Summary:
    reduced = {name: ", ".join(export.reductions) or "nothing" for name, export in exports.items()}
    worst = {
        name: 100.0 * max((d.worst for d in export.reductions.values()), default=0)
        for name, export in exports.items()
    }
    rows = [
        {
            "target": name,
            "file": file,
            "holds": TARGETS[name].holds,
            "reduced": reduced[name],
            "worst_percent": worst[name],
        }
        for name, export in exports.items()
        for file in export.files
    ]
    overview = [
        {
            "target": name,
            "files": len(export.files),
            "worst_percent": worst[name],
            "reduced": reduced[name],
        }
        for name, export in exports.items()
    ]
    valid = law.validity
    return Summary(
        stage="export",
        title=f"contact law of the belt {law.belt.name}",
        out=folder,
        facts={
            "surface": law.friction.method,
            "config": law.provenance.config,
            "measured_force_N_m": valid.measured_force_N_m,
            "valid_force_N_m": valid.normal_force_N_m,
            "valid_speed_m_s": valid.slip_speed_m_s,
        },
        table=rows,
        overview=overview if len(overview) > 1 else [],
        shown=("target", "file", "reduced", "worst_percent"),
        details=_reductions(exports),
        up_to_date=up_to_date,
        origin=law.origin,
    )


def _reductions(exports: Mapping[str, Export]) -> dict[str, list[dict[str, Any]]]:
    """List what targets cannot hold, and how far their substitutes are from the law."""
    rows = [
        {
            "target": name,
            "reduction": reduction,
            "rms_percent": 100.0 * deviation.rms,
            "worst_percent": 100.0 * deviation.worst,
            "where": deviation.where,
        }
        for name, export in exports.items()
        for reduction, deviation in export.reductions.items()
    ]
    return {"reductions": rows} if rows else {}
