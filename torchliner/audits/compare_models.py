"""Several models of a liner on one plane: its moments serve all, so the data are read once."""

from __future__ import annotations

import copy
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from torchliner.checks import require_positive, tell
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.reduction.moments import Moments
from torchliner.reduction.sources import in_full_precision
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare
from torchliner.tdibc.prepared import Progress
from torchliner.tdibc.requested import Request
from torchliner.tdibc.slices import reduce_whole

FIRST = ("true", "in situ")  # references by which models are sorted, before others


@dataclass(frozen=True)
class ModelRow:
    """One model at one frequency.

    Args:
        model: its name.  frequency: Hz.
        impedance: whole liner, normalised, in the order of averaging of the comparison.
        low, high: of its statistical interval (real part: R, imaginary: X); None without one.
        orders: the same in all orders, by name.
        closure: dB that the velocity and Z are off the known pressure; None where none is known.
        verdict: of closure: closes, fails, open; "" for none.
        distance: |Z - reference| by name of the references that the plane holds; empty away from
            its tone.
        model_error: largest error in R of the interpolation over |v|.
    """

    model: str
    frequency: float
    impedance: complex
    low: complex | None
    high: complex | None
    orders: dict[str, complex]
    closure: float | None
    verdict: str
    distance: dict[str, float]
    model_error: float


@dataclass(frozen=True, eq=False)
class ModelComparison:
    """Models side by side, the nearest first.

    Args:
        title, order: of the plane; of averaging.
        level: of the intervals; None without any.
        sorted_by: ``|Z - true|`` or that to another reference; ``|closure|``; or ``as given``.
        references: Z at the tone, by name, as the plane holds them.
        rows: by frequency, then by model.
        maps: of each model, by name, as ``educe`` would give them.
        closure_words: what closure rests on, or why there is none.
        notes: warnings.
    """

    title: str
    order: str
    level: float | None
    sorted_by: str
    references: dict[str, complex]
    rows: tuple[ModelRow, ...]
    maps: dict[str, ImpedanceMap]
    closure_words: str
    notes: tuple[str, ...]


@in_full_precision
def compare_models(
    plane: VelocityPlane | Moments, liners: Mapping[str, Liner], frequency: Any = None, *,
    cell_pitch: float | None = None, reference_phase: Any = None, pressure: Any = None,
    progress: Progress | None = None, **choices: Any,
) -> ModelComparison:  # fmt: skip
    """Educe one plane with several models of its liner, in one pass over the data.

    Args:
        plane: wall-normal velocity, or the moments of one.
        liners: two or more by name, each as for ``educe``.
        frequency: Hz, one or several; default the plane's tone.
        cell_pitch: L_c of the cells, m, which all models share: they belong to the data. Default
            that of the moments, else of the preset that the plane names, else of the models.
        reference_phase, pressure, progress, choices: as for ``educe``, engine ``spectral``.
    Raises:
        ValueError: fewer than two models; a frequency outside a model's range; models that state
            different cells; as ``educe``.
        TypeError: plane is none.
    Warns:
        DataWarning: as ``educe``; models that give the same Z to the last digit.
    """
    if not isinstance(plane, (VelocityPlane, Moments)):
        raise TypeError(f"plane is {type(plane).__name__}; a VelocityPlane or Moments is needed")
    if len(liners) < 2:
        raise ValueError(f"models given: {', '.join(liners) or 'none'}; name two or more, or use educe")
    chosen = Choices(**choices)
    if chosen.engine != "spectral":
        raise ValueError(
            f"models are compared by engine 'spectral', not {chosen.engine!r}; leave engine and incident out"
        )
    models, notes = _of_one_pitch(plane, {n: as_liner(m) for n, m in liners.items()}, cell_pitch)
    if isinstance(plane, Moments):
        known = plane
    else:
        known = reduce_whole(plane, Request([*models.values()], frequency, None, choices), progress)
    maps: dict[str, ImpedanceMap] = {}
    for name, model in models.items():
        try:
            (ready,) = prepare([known], model, frequency, chosen)
        except ValueError as error:
            raise ValueError(f"model {name}: {error}") from error
        maps[name] = replay(ready).map(chosen.phase, reference_phase, pressure)
    notes += [*_notes_of(maps, known.notes), *_alike(maps)]
    tell(notes)
    return _sorted(known.plane, maps, chosen, (*known.notes, *notes))


def _of_one_pitch(
    plane: VelocityPlane | Moments, models: dict[str, LinerModel], pitch: float | None
) -> tuple[dict[str, LinerModel], list[str]]:
    """The models with the cells of the data, and whose cells they are where a model has others."""
    stated = {model.cell_pitch for model in models.values() if model.cell_pitch is not None}
    whose = "cell_pitch"
    if isinstance(plane, Moments):
        if pitch is not None and pitch != plane.cell_pitch:
            raise ValueError(
                f"{plane.plane.name} holds moments over cells of {_millimetres(plane.cell_pitch)}, "
                f"not {_millimetres(pitch)}; leave cell_pitch out, or reduce the data again"
            )
        pitch, whose = plane.cell_pitch, "the moments"
    elif pitch is not None:
        require_positive("cell_pitch (m)", pitch)
    elif plane.liner in preset_names():
        pitch, whose = load_liner(plane.liner).cell_pitch, f"{plane.liner}, which the plane names"
    elif len(stated) > 1:
        each = ", ".join(f"{n} {_millimetres(m.cell_pitch)}" for n, m in models.items())
        raise ValueError(
            f"the models state different cells: {each}; state cell_pitch, that of the liner below {plane.name}"
        )
    else:
        pitch = next(iter(stated), None)
    others = [f"{n} {_millimetres(m.cell_pitch)}" for n, m in models.items()
              if m.cell_pitch not in (None, pitch)]  # fmt: skip
    notes = [f"cells are of {_millimetres(pitch)} ({whose}) for all models; as files: "
             f"{', '.join(others)}"] if others else []  # fmt: skip
    return {name: _with_pitch(model, pitch) for name, model in models.items()}, notes


def _with_pitch(model: LinerModel, pitch: float | None) -> LinerModel:
    """A copy that differs in its cells alone; of models without ``replace`` too."""
    if model.cell_pitch == pitch:
        return model
    found = copy.copy(model)
    object.__setattr__(found, "cell_pitch", pitch)
    return found


def _millimetres(pitch: float | None) -> str:
    return "all probes" if pitch is None else f"{1e3 * float(pitch):.4g} mm"


def _notes_of(maps: Mapping[str, ImpedanceMap], said: tuple[str, ...]) -> list[str]:
    """Each note once: of all models as it is, of some with their names."""
    whose: dict[str, list[str]] = {}
    for name, found in maps.items():
        for note in found.notes:
            whose.setdefault(note, []).append(name)
    return [
        note if len(names) == len(maps) else f"{', '.join(names)}: {note}"
        for note, names in whose.items()
        if note not in said
    ]


def _alike(maps: Mapping[str, ImpedanceMap]) -> list[str]:
    """Models under two names."""
    names = list(maps)
    return [
        f"{one} and {other} give the same Z to the last digit: one model under two names?"
        for i, one in enumerate(names)
        for other in names[i + 1 :]
        if bool((maps[one].answer == maps[other].answer).all())
    ]


def _sorted(
    plane: VelocityPlane, maps: dict[str, ImpedanceMap], chosen: Choices, notes: tuple[str, ...]
) -> ModelComparison:
    first = next(iter(maps.values()))
    tone = first.tone
    references = {} if tone is None else first.reference_at(tone)
    rows = {
        name: [_row(name, found, i, found.reference_at(i)) for i in range(len(found.frequency))]
        for name, found in maps.items()
    }  # fmt: skip
    key = next((name for name in (*FIRST, *references) if name in references), None)
    sorted_by = "as given" if first.closure is None else "|closure|"

    def size(name: str) -> float:
        if key is not None and tone is not None:
            return rows[name][tone].distance[key]
        off = [abs(row.closure) for row in rows[name] if row.closure is not None]
        return max(off, default=0.0)

    order = sorted(maps, key=size)
    return ModelComparison(
        first.title or plane.name, first.order,
        None if first.uncertainty is None else chosen.interval,
        sorted_by if key is None else f"|Z - {key}|", references,
        tuple(rows[name][i] for i in range(len(first.frequency)) for name in order),
        {name: maps[name] for name in order}, first.closure_words, notes,
    )  # fmt: skip


def _row(name: str, found: ImpedanceMap, i: int, references: Mapping[str, complex]) -> ModelRow:
    closure, off, verdict = found.closure, None, ""
    if closure is not None:
        level = float(closure.liner.level[closure.orders.index(found.order), i])
        off, verdict = None if math.isnan(level) else level, closure.verdict(found.order, i)
    z = complex(found.answer[i])
    low, high = found.bounds_of_liner(found.order, i) or (None, None)
    return ModelRow(
        name, float(found.frequency[i]), z, low, high,
        {order: complex(found.of_liner(order)[i]) for order in found.orders}, off, verdict,
        {reference: abs(z - value) for reference, value in references.items()},
        float(found.choices.get("model_error", math.nan)),
    )  # fmt: skip
