"""Several models of a liner on one plane: its moments serve all, so the data are read once."""

from __future__ import annotations

import copy
import math
import warnings
from collections.abc import Mapping
from typing import Any

from torchliner.checks import SAME_FREQUENCY, DataWarning, require_positive, tell
from torchliner.engine.moments import Moments
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import Records, plane_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import moments
from torchliner.velocity.reading import Progress

FIRST = ("true", "in situ")  # references by which models are sorted, before others


def compare_models(
    plane: VelocityPlane | Moments,
    liners: Mapping[str, Liner],
    frequency: Any = None,
    *,
    cell_pitch: float | None = None,
    reference_phase: float | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Study:
    """Educe one plane with several models of its liner, for which the data are read as often as for one.

    Args:
        plane: wall-normal velocity, or the moments of one.
        liners: two or more by name, each as for ``educe``.
        frequency: Hz, one or several; default the plane's tone.
        cell_pitch: L_c of the cells, m, which all models share: they belong to the data. Default that of the moments,
            else of the preset that the plane names, else of the first model that states one.
        reference_phase: rad, for ``phase="given"``.
        progress, choices: as for ``educe``.
    Returns:
        title, averaging, level (of the intervals; None without any), sorted_by (``|Z - true|`` or that to another
        reference; ``|level check|``; or ``as given``), references (Z at the tone, by name, as the plane holds them),
        level_check_words, notes. ``rows``, by frequency, then the nearest model first: model, frequency (Hz),
        impedance, low, high (of its interval; None without), averagings (Z in all of them, by name), level_check (dB;
        None without), distance (|Z - reference| by name; empty away from the tone), model_error (largest error in R of
        the interpolation over |v|).
    Raises:
        ValueError: fewer than two models; a frequency outside a model's range; as ``educe``.
        TypeError: plane is none.
    Warns:
        DataWarning: of the data and of each model, as ``educe``; models of other cells.
    """
    facts, chosen = plane_of(plane), Choices(**choices)
    if len(liners) < 2:
        raise ValueError(f"models given: {', '.join(liners) or 'none'}; name two or more, or use educe")
    models, notes = _of_one_pitch(plane, {n: as_liner(m) for n, m in liners.items()}, cell_pitch)
    if (chosen.phase == "given") != (reference_phase is not None):
        raise ValueError("phase 'given' and reference_phase, in rad, go together; state both, or neither")
    known = plane
    if isinstance(known, VelocityPlane):
        known = moments(known, [*models.values()], frequency, progress=progress, **vars(chosen))  # type: ignore[arg-type]
    lines, about = facts.asked(frequency), {"reference_phase": reference_phase, **vars(chosen)}
    tone = facts.frequency or (float(lines[0]) if len(lines) == 1 else 0.0)
    key = next((name for name in (*FIRST, *facts.reference) if name in facts.reference), None)
    rows, sizes, shared = list[Row](), dict[str, float](), list[Any]()
    maps: dict[str, ImpedanceMap] = {}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # told once, below
        for name, model in models.items():
            maps[name] = known.educe(model, frequency, **about)
    shared = [note for note in next(iter(maps.values())).notes if all(note in each.notes for each in maps.values())]
    notes += [note.text for note in shared]
    for name, found in maps.items():
        notes += [f"{name}: {note.text}" for note in found.notes if note not in shared and note.code != "level-check"]
        check, level = found.level_check, math.nan
        for i, f in enumerate(lines.tolist()):
            z = {each: complex(educed.impedance[i]) for each, educed in found.liner.items()}
            low, high = found.bounds_of_liner(chosen.averaging, i) or (None, None)
            if check is not None:
                level = float(check.liner.level[check.averagings.index(chosen.averaging), i])
            held = facts.reference if abs(f - tone) < SAME_FREQUENCY * tone else {}
            row = Row(model=name, averaging=chosen.averaging, frequency=f, impedance=z[chosen.averaging])
            row |= {"low": low, "high": high, "level_check": level if math.isfinite(level) else None, "averagings": z}
            row["distance"] = {reference: abs(row.impedance - value) for reference, value in held.items()}
            rows.append(Row(row, model_error=found.choices["model_error"]))
            sizes[name] = max(sizes.get(name, 0.0), row.distance.get(key, abs(row.level_check or 0.0)))
    tell(notes)
    referred, checked = any(row.distance for row in rows), rows[0].level_check is not None
    return Study(
        title=facts.title or facts.name,
        averaging=chosen.averaging,
        level=None if rows[0].low is None else chosen.interval,
        sorted_by=f"|Z - {key}|" if referred else "|level check|" if checked else "as given",
        references=dict(facts.reference) if referred else {},
        rows=tuple(sorted(rows, key=lambda row: (row.frequency, sizes[row.model]))),
        level_check_words=next(iter(maps.values())).level_check_words,
        notes=tuple(notes),
    )


def _of_one_pitch(
    plane: Records, models: dict[str, LinerModel], pitch: float | None
) -> tuple[dict[str, LinerModel], list[str]]:
    """The models with the cells of the data, in its flow, and whose cells they are where a model has others."""
    each = {name: model.cell_pitch for name, model in models.items() if model.cell_pitch is not None}
    whose, facts = "cell_pitch", plane_of(plane)
    if pitch is not None:
        require_positive("cell_pitch (m)", pitch)
    elif isinstance(plane, Moments):
        pitch, whose = plane.cell_pitch, "the moments"
    elif facts.liner in preset_names():
        pitch, whose = load_liner(facts.liner).cell_pitch, f"{facts.liner}, which the plane names"
    elif each:
        whose, pitch = next(iter(each.items()))
    others = ", ".join(f"{name} {1e3 * own:.4g} mm" for name, own in each.items() if own != pitch)
    notes = [f"cells are of {1e3 * (pitch or 0):.4g} mm ({whose}) for all models; as files: {others}"] if others else []
    copies = {name: copy.copy(model.in_flow(facts.mach)) for name, model in models.items()}
    for model in copies.values():  # of models without ``replace`` too
        object.__setattr__(model, "cell_pitch", pitch)
    return copies, notes
