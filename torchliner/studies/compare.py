"""Comparisons: two maps of the same cells, and several models of a liner on one plane."""

import copy
import itertools
import math
from collections.abc import Mapping
from typing import Any

import torch

from torchliner.checks import SAME_FREQUENCY, index_of_frequency, require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.educed import Educed, Interval
from torchliner.studies.variants import Row, Study, plane_of, read_for
from torchliner.velocity.answer import answer, fitting
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Progress

SAME_PLACE = 1e-6  # m
SAME_RECORD = 1e-4  # of the rms: two records of a flow never share the rms of all probes
FIRST = ("true", "in situ")  # references by which models are sorted, before others


def compare(first: ImpedanceMap, second: ImpedanceMap, averaging: str | None = None) -> Study:
    """Z of ``second`` less that of ``first``, of the whole liner and of each cell.

    The errors of independent records are independent, so squares of half-widths add. Those of one run (one case in the
    provenance, or the same rms of v at all probes) are not, by how much is not known: half-widths add, an upper bound.

    Args:
        first, second: of the same cells and frequencies, in any order of these.
        averaging: default that of both.
    Returns:
        averaging, level (of the intervals; None without any), same_run, words (what the intervals are). ``rows``, the
        whole liner first, then cells, by frequency: place (``liner`` or ``cell 0``, ...), x, z (its centre, m),
        frequency (Hz), first, second, difference (Z), low, high (of its statistical interval; None without), differs_in
        (parts whose interval has no 0: "R", "X", "R, X" or "").
    Raises:
        ValueError: other cells, frequencies, averagings or levels of the interval.
    """
    if averaging is None and first.averaging != second.averaging:
        raise ValueError(
            f"the maps answer by averaging {first.averaging!r} and {second.averaging!r}; name one that both hold"
        )
    averaging = averaging or first.averaging
    for each in (first, second):
        require_choice("averaging", averaging, each.averagings)
    order, same = _common_order(first, second), _same_run(first, second)
    level = None if None in (first.level, second.level) else first.level
    one, two = (_together(each, averaging) for each in (first, second))
    two, ends = two.map(lambda value: value[:, order]), None
    if level is not None and one.interval is not None and two.interval is not None:
        # In real parts: complex differences of infinite ends are nan.
        low, high = (torch.view_as_real(end) for end in (one.interval.low, one.interval.high))
        least, most = (torch.view_as_real(end) for end in (two.interval.low, two.interval.high))
        widths = torch.stack([high - low, most - least]) / 2
        half = widths.sum(0) if same else widths.square().sum(0).sqrt()
        # An unbounded interval has no middle.
        middle = torch.where(half.isinf(), 0, (least + most - low - high) / 2)
        ends = torch.stack([middle - half, middle + half], -2)
    here, there, rows = one.impedance.tolist(), two.impedance.tolist(), list[Row]()
    x, z = ([math.nan, *value.tolist()] for value in (first.cell_x, first.cell_z))
    for i, (k, f) in itertools.product(range(len(x)), enumerate(first.frequency.tolist())):
        row = Row(place=f"cell {i - 1}" if i else "liner", x=x[i], z=z[i], frequency=f)
        row |= {"first": here[i][k], "second": there[i][k], "difference": there[i][k] - here[i][k]}
        row |= {"low": None, "high": None, "differs_in": ""}
        if ends is not None:
            left, right = ends[i, k].tolist()
            clear = [part for part, start, end in zip("RX", left, right, strict=True) if start > 0 or end < 0]
            row |= {"low": complex(*left), "high": complex(*right), "differs_in": ", ".join(clear)}
        rows.append(row)
    how = "an upper bound: both rest on one run, half-widths added" if same else "of independent records"
    words = f"{100 * level:g} % statistical interval, {how}" if level else "no intervals: one of the maps has none"
    return Study(averaging=averaging, level=level, same_run=same, words=words, rows=tuple(rows))


def _together(one: ImpedanceMap, averaging: str) -> Educed:
    """That of the liner above those of the cells, (1 + C, F)."""
    parts = one.liner[averaging].map(lambda value: value[None]), one.cells[averaging]
    bars = [part.interval for part in parts if part.interval is not None]
    return Educed(torch.cat([part.reflection for part in parts]), Interval.joined(bars) if len(bars) == 2 else None)


def _common_order(first: ImpedanceMap, second: ImpedanceMap) -> list[int]:
    """Where the frequencies of the first map are in the second; ValueError unless all else is alike."""
    lists = [each.frequency.tolist() for each in (first, second)]
    order = [i for f in lists[0] if (i := index_of_frequency(second.frequency, f)) is not None]
    if not len(order) == len(lists[0]) == len(lists[1]):
        raise ValueError(f"the maps have other frequencies: {lists[0]} Hz and {lists[1]} Hz; educe both at the same")
    counts = [len(each.cell_x) for each in (first, second)]
    pairs = ((first.cell_x, second.cell_x), (first.cell_z, second.cell_z))
    if counts[0] != counts[1] or not all(torch.allclose(*pair, 0, SAME_PLACE, equal_nan=True) for pair in pairs):
        raise ValueError(
            f"the maps have other cells ({counts[0]} and {counts[1]}); educe planes of the same extent with liners of "
            "one cell_pitch"
        )
    if None not in (first.level, second.level) and first.level != second.level:
        raise ValueError(f"the maps have intervals of {first.level} and {second.level}; educe both with the same")
    return order


def _same_run(first: ImpedanceMap, second: ImpedanceMap) -> bool:
    """By the case that they state, or by the rms of v, but for probes that one of them left out."""
    cases = [dict(each.choices.get("data") or {}).get("case") for each in (first, second)]
    if cases[0] is not None and cases[0] == cases[1]:
        return True
    one, other = (each.velocity_rms.double().cpu() for each in (first, second))
    if one.shape != other.shape:
        return False
    known = torch.isfinite(one + other)
    return bool(known.any()) and bool(((one - other).abs() <= SAME_RECORD * one)[known].all())


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
        cell_pitch: L_c, m, of the cells of all models; default that of the moments, else of the preset that the
            plane names, else of the first model.
        reference_phase: rad, for ``phase="given"``.
        progress, choices: as for ``educe``.
    Returns:
        title, averaging, level (of the intervals; None without any), sorted_by (``|Z - true|`` or that to another
        reference; ``|level check|``; or ``as given``), references (Z at the tone, by name), level_check_words, notes.
        ``rows``, by frequency, then the nearest model first: model, frequency (Hz), impedance, low, high, level_check
        (dB), distance (|Z - reference| by name; empty away from the tone), model_error (largest error in R of the
        interpolation over |v|).
    Raises:
        ValueError: fewer than two models; a frequency outside a model's range; as ``educe``.
    Warns:
        DataWarning: of the data and of each model, as ``educe``; models of other cells.
    """
    facts, chosen = plane_of(plane), Choices(**choices)
    if len(liners) < 2:
        raise ValueError(f"models given: {', '.join(liners) or 'none'}; name two or more, or use educe")
    models = {name: copy.copy(as_liner(liner).in_flow(facts.mach)) for name, liner in liners.items()}
    pitches = {f"{1e3 * model.cell_pitch:.4g}" for model in models.values() if model.cell_pitch is not None}
    named = load_liner(facts.liner) if facts.liner in preset_names() else next(iter(models.values()))
    own = plane.cell_pitch if isinstance(plane, Moments) else named.cell_pitch
    pitch, lines, notes = own if cell_pitch is None else cell_pitch, facts.asked(frequency), list[str]()
    if pitches - {f"{1e3 * (pitch or 0):.4g}"}:
        notes.append(f"cells are of {1e3 * (pitch or 0):.4g} mm for all models; as files: {', '.join(pitches)} mm")
    for model in models.values():  # of models without ``replace`` too
        object.__setattr__(model, "cell_pitch", pitch)
    known = plane
    if isinstance(known, VelocityPlane):
        known, _ = read_for(known, [*models.values()], lines, chosen, (), progress)
    with torch.no_grad():
        ways = {name: fitting(known, model, lines, chosen) for name, model in models.items()}
        maps = {name: answer(known, model, lines, ways[name], reference_phase) for name, model in models.items()}
    first, *others = maps.values()
    shared = [note for note in first.notes if all(note in each.notes for each in others)]
    notes += [note.text for note in shared if note.code != "level-check"]
    for name, each in maps.items():
        notes += [f"{name}: {note.text}" for note in each.notes if note not in shared and note.code != "level-check"]
    tell(notes)
    tone = facts.frequency or (float(lines[0]) if len(lines) == 1 else 0.0)
    key = next((name for name in (*FIRST, *facts.reference) if name in facts.reference), None)
    rows, sizes = list[Row](), dict[str, float]()
    for name, each in maps.items():
        z, check = each.liner[chosen.averaging].impedance.tolist(), each.level_check
        levels = [math.nan] * len(z)
        if check is not None:
            levels = check.liner.level[check.averagings.index(chosen.averaging)].tolist()
        for i, f in enumerate(lines.tolist()):
            low, high = each.bounds_of_liner(chosen.averaging, i) or (None, None)
            near = facts.reference if abs(f - tone) < SAME_FREQUENCY * tone else {}
            row = Row(model=name, frequency=f, impedance=z[i], low=low, high=high)
            row |= {"level_check": levels[i] if math.isfinite(levels[i]) else None}
            row |= {"distance": {reference: abs(z[i] - value) for reference, value in near.items()}}
            rows.append(Row(row, model_error=each.choices["model_error"]))
            size = row.distance.get(key, abs(row.level_check or 0.0))
            sizes[name] = max(sizes.get(name, 0.0), size)
    referred, checked = any(row.distance for row in rows), rows[0].level_check is not None
    return Study(
        title=facts.title or facts.name,
        averaging=chosen.averaging,
        level=None if rows[0].low is None else chosen.interval,
        sorted_by=f"|Z - {key}|" if referred else "|level check|" if checked else "as given",
        references=dict(facts.reference) if referred else {},
        rows=tuple(sorted(rows, key=lambda row: (row.frequency, sizes[row.model]))),
        level_check_words=first.level_check_words,
        notes=tuple(notes),
    )
