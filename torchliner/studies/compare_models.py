"""Several models of a liner on one plane: its moments serve all, so the data are read once."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Mapping
from typing import Any

import torch

from torchliner.checks import require_positive, tell
from torchliner.engine.moments import Moments
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import Records, Source, plane_of
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Progress
from torchliner.velocity.review import review_record

FIRST = ("true", "in situ")  # references by which models are sorted, before others


def compare_models(
    plane: VelocityPlane | Moments,
    liners: Mapping[str, Liner],
    frequency: Any = None,
    *,
    cell_pitch: float | None = None,
    reference_phase: Any = None,
    pressure: Any = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Study:
    """Educe one plane with several models of its liner, for which the data are read as often as for one.

    Args:
        plane: wall-normal velocity, or the moments of one.
        liners: two or more by name, each as for ``educe``.
        frequency: Hz, one or several; default the plane's tone.
        cell_pitch: L_c of the cells, m, which all models share: they belong to the data. Default that of the moments,
            else of the preset that the plane names, else of the models.
        reference_phase, pressure, progress, choices: as for ``educe``.
    Returns:
        title, averaging, level (of the intervals; None without any), sorted_by (``|Z - true|`` or that to another
        reference; ``|level check|``; or ``as given``), references (Z at the tone, by name, as the plane holds them),
        maps (of each model, by name, as ``educe`` gives them), level_check_words, notes. ``rows``, by frequency, then
        the nearest model first: model, frequency (Hz), impedance, low, high, averagings (Z in all of them, by name),
        level_check (dB), verdict (of it: passes, fails, inconclusive; "" for none), distance (|Z - reference| by name;
        empty away from the tone), model_error (largest error in R of the interpolation over |v|).
    Raises:
        ValueError: fewer than two models; a frequency outside a model's range; models that state different cells; as
            ``educe``.
        TypeError: plane is none.
    Warns:
        DataWarning: as ``educe``; models that give the same Z to the last digit.
    """
    if not isinstance(plane, Records):
        raise TypeError(f"plane is {type(plane).__name__}; a VelocityPlane or Moments is needed")
    if len(liners) < 2:
        raise ValueError(f"models given: {', '.join(liners) or 'none'}; name two or more, or use educe")
    models, notes = _of_one_pitch(plane, {n: as_liner(m) for n, m in liners.items()}, cell_pitch)
    chosen = Choices(**choices)
    source = Source(plane, [*models.values()], frequency, chosen, progress=progress)
    maps: dict[str, ImpedanceMap] = {}
    for name, model in models.items():
        try:
            with torch.no_grad():
                maps[name] = answer(source.known, model, source.frequency, chosen, reference_phase, pressure)
        except ValueError as error:
            raise ValueError(f"model {name}: {error}") from error
    # Of all models as it is, of some with their names.
    shared = [note.text for note in (*source.known.notes, *review_record(source.plane, source.frequency))]
    whose: dict[str, list[str]] = {}
    for name, found in maps.items():
        for note in found.notes:
            whose.setdefault(note.text, []).append(name)
    others = {text: names for text, names in whose.items() if text not in shared}
    notes += [text if len(names) == len(maps) else f"{', '.join(names)}: {text}" for text, names in others.items()]
    notes += [
        f"{one} and {other} give the same Z to the last digit: one model under two names?"
        for one, other in itertools.combinations(maps, 2)
        if bool((maps[one].answer == maps[other].answer).all())
    ]
    notes = [*dict.fromkeys(shared), *notes]
    tell(notes)
    first = next(iter(maps.values()))
    references = {} if first.tone is None else first.reference_at(first.tone)
    rows = {name: [_row(name, found, i) for i in range(len(found.frequency))] for name, found in maps.items()}
    key = next((name for name in (*FIRST, *references) if name in references), None)

    def size(name: str) -> float:
        if key is not None and first.tone is not None:
            return rows[name][first.tone].distance[key]
        return max((abs(row.level_check) for row in rows[name] if row.level_check is not None), default=0.0)

    nearest = sorted(maps, key=size)
    by = "as given" if first.level_check is None else "|level check|"
    return Study(
        title=first.title or source.plane.name,
        averaging=first.averaging,
        level=first.level,
        sorted_by=by if key is None else f"|Z - {key}|",
        references=references,
        rows=tuple(row for at in zip(*(rows[name] for name in nearest), strict=True) for row in at),
        maps={name: maps[name] for name in nearest},
        level_check_words=first.level_check_words,
        notes=tuple(notes),
    )


def _of_one_pitch(
    plane: Records, models: dict[str, LinerModel], pitch: float | None
) -> tuple[dict[str, LinerModel], list[str]]:
    """The models with the cells of the data, and whose cells they are where a model has others."""
    stated = {model.cell_pitch for model in models.values() if model.cell_pitch is not None}
    whose, facts = "cell_pitch", plane_of(plane)
    each = {name: f"{name} {_millimetres(model.cell_pitch)}" for name, model in models.items()}
    if isinstance(plane, Moments):
        if pitch is not None and pitch != plane.cell_pitch:
            raise ValueError(
                f"{facts.name} holds moments over cells of {_millimetres(plane.cell_pitch)}, "
                f"not {_millimetres(pitch)}; leave cell_pitch out, or reduce the data again"
            )
        pitch, whose = plane.cell_pitch, "the moments"
    elif pitch is not None:
        require_positive("cell_pitch (m)", pitch)
    elif facts.liner in preset_names():
        pitch, whose = load_liner(facts.liner).cell_pitch, f"{facts.liner}, which the plane names"
    elif len(stated) > 1:
        raise ValueError(
            f"the models state different cells: {', '.join(each.values())}; state cell_pitch, that of the liner below "
            f"{facts.name}"
        )
    else:
        pitch = next(iter(stated), None)
    others = ", ".join(each[name] for name, model in models.items() if model.cell_pitch not in (None, pitch))
    notes = [f"cells are of {_millimetres(pitch)} ({whose}) for all models; as files: {others}"] if others else []
    # Of models without ``replace`` too.
    copies = {name: copy.copy(model) for name, model in models.items()}
    for model in copies.values():
        object.__setattr__(model, "cell_pitch", pitch)
    return copies, notes


def _millimetres(pitch: float | None) -> str:
    return "all probes" if pitch is None else f"{1e3 * float(pitch):.4g} mm"


def _row(name: str, found: ImpedanceMap, i: int) -> Row:
    check = found.level_check
    z = complex(found.answer[i])
    low, high = found.bounds_of_liner(found.averaging, i) or (None, None)
    return Row(
        model=name,
        frequency=float(found.frequency[i]),
        impedance=z,
        low=low,
        high=high,
        averagings={each: complex(found.liner[each].impedance[i]) for each in found.averagings},
        level_check=None if check is None else check.liner.at(check.averagings.index(found.averaging), i)["level"],
        verdict="" if check is None else check.verdict(found.averaging, i),
        distance={reference: abs(z - value) for reference, value in found.reference_at(i).items()},
        model_error=float(found.choices.get("model_error", math.nan)),
    )
