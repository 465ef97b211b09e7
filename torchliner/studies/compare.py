"""Comparisons: two maps of the same cells, and several models of a liner on one plane."""

import copy
import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.variants import Row, Study, plane_of, read_for, rows_of
from torchliner.velocity.choices import Choices
from torchliner.velocity.educe import answer, fitting
from torchliner.velocity.reading import Progress

SAME_PLACE = 1e-6  # m


def compare(first: ImpedanceMap, second: ImpedanceMap, averaging: str | None = None) -> Study:
    """Z of ``second`` less that of ``first``, of the whole liner and of each cell.

    Half-widths of the intervals add. That is an upper bound, whatever the two records share.

    Args:
        first, second: of the same cells and frequencies.
        averaging: default that of the first.
    Returns:
        averaging, words (what the intervals are), level (of them; None without any). ``rows``, the whole liner first:
        place (``liner`` or ``cell 0``, ...), x, z (its centre, m), frequency (Hz), first, second, difference (Z), low,
        high (of its statistical interval; None without), differs_in (parts whose interval has no 0: "R", "X", "R, X").
    """
    averaging = averaging or first.averaging
    for each in (first, second):
        require_choice("averaging", averaging, each.averagings)
    lists, counts = [each.frequency.tolist() for each in (first, second)], [len(e.cell_x) for e in (first, second)]
    if lists[0] != lists[1]:
        raise ValueError(f"the maps have other frequencies: {lists[0]} Hz and {lists[1]} Hz; educe both at the same")
    pairs = ((first.cell_x, second.cell_x), (first.cell_z, second.cell_z))
    if counts[0] != counts[1] or not all(torch.allclose(*pair, 0, SAME_PLACE, equal_nan=True) for pair in pairs):
        raise ValueError(
            f"the maps have other cells ({counts[0]} and {counts[1]}); educe planes of the same extent with liners of "
            "one cell_pitch"
        )
    level = None if None in (first.level, second.level) else first.level
    if level is not None and first.level != second.level:
        raise ValueError(f"the maps have intervals of {first.level} and {second.level}; educe both with the same")
    one, two = (_stacked(each, averaging) for each in (first, second))
    rows = rows_of(
        place=[["liner"], *([f"cell {i}"] for i in range(counts[0]))],
        x=[[math.nan], *first.cell_x[:, None].tolist()],
        z=[[math.nan], *first.cell_z[:, None].tolist()],
        frequency=first.frequency,
        first=one["impedance"],
        second=two["impedance"],
        difference=two["impedance"] - one["impedance"],
        low=None if level is None else _less(two["low"], one["high"]),
        high=None if level is None else _less(two["high"], one["low"]),
    )
    for row in rows:
        row["differs_in"] = ""
        if level is not None:
            ends = {"R": (row.low.real, row.high.real), "X": (row.low.imag, row.high.imag)}
            row["differs_in"] = ", ".join(part for part, (low, high) in ends.items() if low > 0 or high < 0)
    words = "no intervals: one of the maps has none"
    if level is not None:
        words = f"{100 * level:g} % statistical interval, half-widths added: an upper bound"
    return Study(averaging=averaging, level=level, words=words, rows=tuple(rows))


def _stacked(one: ImpedanceMap, averaging: str) -> dict[str, Any]:
    """Values and ends of the liner above those of the cells, (1 + C, F)."""
    liner, cells = one.liner[averaging], one.cells[averaging]
    names = ("impedance",) if liner.interval is None else ("impedance", "low", "high")
    return {name: torch.cat([getattr(liner, name)[None], getattr(cells, name)]) for name in names}


def _less(one: Tensor, other: Tensor) -> Tensor:
    """A difference in real parts: complex ones of infinite ends are nan."""
    return torch.view_as_complex(torch.view_as_real(one) - torch.view_as_real(other))


def compare_models(
    plane: VelocityPlane | Moments,
    liners: Mapping[str, Liner],
    frequency: Any = None,
    *,
    reference_phase: float | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Study:
    """Educe one plane with several models of its liner, for which the data are read as often as for one.

    Args:
        plane: wall-normal velocity, or the moments of one. Cells are those of the moments, else of the preset that the
            plane names, else of the first model.
        liners: two or more by name, each as for ``educe``.
        frequency: Hz, one or several; default the plane's tone.
        reference_phase: rad, for ``phase="given"``.
        progress, choices: as for ``educe``.
    Returns:
        references (Z at the tone, by name). ``rows``, by frequency: model, frequency (Hz), impedance, low, high,
        level_check (dB), distance (|Z - reference| by name; empty away from the tone), model_error (largest error
        in R of the interpolation over |v|).
    """
    facts, chosen = plane_of(plane), Choices(**choices)
    if len(liners) < 2:
        raise ValueError(f"models given: {', '.join(liners) or 'none'}; name two or more, or use educe")
    models = {name: copy.copy(as_liner(liner).in_flow(facts.mach)) for name, liner in liners.items()}
    pitches, lines, texts = [model.cell_pitch for model in models.values()], facts.asked(frequency), dict[str, Any]()
    pitch = load_liner(facts.liner).cell_pitch if facts.liner in preset_names() else pitches[0]
    pitch = plane.cell_pitch if isinstance(plane, Moments) else pitch
    for model in models.values():  # of models without ``replace`` too
        object.__setattr__(model, "cell_pitch", pitch)
    known = plane if isinstance(plane, Moments) else read_for(plane, [*models.values()], lines, chosen, (), progress)[0]
    with torch.no_grad():
        ways = {name: fitting(known, model, lines, chosen) for name, model in models.items()}
        maps = {name: answer(known, model, lines, ways[name], reference_phase) for name, model in models.items()}
    for name, each in maps.items():
        for note in (note for note in each.notes if note.code != "level-check"):
            texts.setdefault(note.text, []).append(name)
    notes = [text if len(names) == len(maps) else f"{names[0]}: {text}" for text, names in texts.items()]
    if any(each != pitch and each is not None for each in pitches):
        notes.insert(0, f"cells are of {1e3 * (pitch or 0):.4g} mm for all models, of which some state others")
    tell(notes)
    tone = facts.frequency or (float(lines[0]) if len(lines) == 1 else 0.0)
    rows = list[Row]()
    for name, each in maps.items():
        found, check = each.liner[chosen.averaging], each.level_check
        level = None if check is None else check.liner.level[check.averagings.index(chosen.averaging)]
        about: dict[str, Any] = {"model": name, "frequency": lines, "model_error": each.choices["model_error"]}
        own = rows_of(**about, impedance=found.impedance, interval=found.interval, level_check=level)
        for row in own:
            near = facts.reference if abs(row.frequency - tone) < SAME_FREQUENCY * tone else {}
            row["distance"] = {reference: abs(row.impedance - value) for reference, value in near.items()}
            row["level_check"] = None if row.level_check is None or math.isnan(row.level_check) else row.level_check
        rows += own
    return Study(
        title=facts.title or facts.name,
        averaging=chosen.averaging,
        level=None if rows[0].low is None else chosen.interval,
        references=dict(facts.reference) if any(row.distance for row in rows) else {},
        rows=tuple(sorted(rows, key=lambda row: row.frequency)),
        level_check_words=next(iter(maps.values())).level_check_words,
        notes=tuple(notes),
    )
