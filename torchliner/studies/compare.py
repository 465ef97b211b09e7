"""Comparisons: two maps of the same cells, and several models of a liner on one plane."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Mapping
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, index_of_frequency, require_choice, tell
from torchliner.engine.moments import Moments
from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.liners.model import Liner, as_liner
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.educed import Interval
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import Variant, evaluate, plane_of, read_for
from torchliner.velocity.answer import answer, require_fitting
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Progress
from torchliner.velocity.review import review_liner, review_table

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
    order, same = _require_alike(first, second), _same_run(first, second)
    level = None if None in (first.level, second.level) else first.level
    (here, own), (there, other) = _values(first, averaging), _values(second, averaging)
    there, other = there[:, order], [end[:, order] for end in other]
    ends: list[Tensor] = []
    if level is not None:
        widths = torch.stack([(high - low) / 2 for low, high in (own, other)])
        half = widths.sum(0) if same else widths.square().sum(0).sqrt()
        # An unbounded interval has no middle.
        middle = torch.where(half.isinf(), 0, (other[0] + other[1] - own[0] - own[1]) / 2)
        ends = [torch.view_as_complex(end) for end in (middle - half, middle + half)]
    x, z = ([math.nan, *value.tolist()] for value in (first.cell_x, first.cell_z))
    rows = list[Row]()
    for i, k in itertools.product(range(len(x)), range(len(order))):
        low, high = (complex(end[i, k]) for end in ends) if ends else (None, None)
        one, two = complex(here[i, k]), complex(there[i, k])
        row = Row(place=f"cell {i - 1}" if i else "liner", x=x[i], z=z[i], frequency=float(first.frequency[k]))
        row |= {"first": one, "second": two, "difference": two - one, "low": low, "high": high}
        rows.append(Row(row, differs_in=_clear(low, high)))
    how = "an upper bound: both rest on one run, half-widths added" if same else "of independent records"
    words = f"{100 * level:g} % statistical interval, {how}" if level else "no intervals: one of the maps has none"
    return Study(averaging=averaging, level=level, same_run=same, words=words, rows=tuple(rows))


def _clear(low: complex | None, high: complex | None) -> str:
    """Parts whose interval does not hold 0."""
    if low is None or high is None:
        return ""
    ends = {"R": (low.real, high.real), "X": (low.imag, high.imag)}
    return ", ".join(part for part, (least, most) in ends.items() if least > 0 or most < 0)


def _values(one: ImpedanceMap, averaging: str) -> tuple[Tensor, list[Tensor]]:
    """Z of the liner above that of the cells, (1 + C, F), and the ends of its interval in real parts, (1 + C, F, 2):
    complex differences of infinite ends are nan."""
    liner, cells = one.liner[averaging], one.cells[averaging]
    value = torch.cat([liner.impedance[None], cells.impedance])
    if liner.interval is None or cells.interval is None:
        return value, []
    every = Interval.joined([liner.interval.map(lambda end: end[None]), cells.interval])
    return value, [torch.view_as_real(end) for end in (every.low, every.high)]


def _require_alike(first: ImpedanceMap, second: ImpedanceMap) -> list[int]:
    """Where the frequencies of the first map are in the second."""
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
    first, errors = next(iter(models.values())), dict[str, float]()
    with torch.no_grad():
        found = answer(known, first, lines, chosen, reference_phase)
    averaging, psi = chosen.averaging, reference_phase
    variants = [Variant({"model": n}, known, model, averaging, chosen, psi) for n, model in models.items()]
    rows = evaluate(variants, lines, known)
    own_notes = [*review_liner(facts, first), *review_table(known, first, lines, found.answer)[1]]
    notes += [note.text for note in found.notes if note not in own_notes and note.code != "level-check"]
    for name, model in models.items():
        require_fitting(known, model, lines, chosen)
        z = torch.tensor([row.impedance for row in rows if row.model == name])
        errors[name], doubts = review_table(known, model, lines, z)
        notes += [f"{name}: {note.text}" for note in (*review_liner(facts, model), *doubts)]
    tell(notes)
    tone = facts.frequency or (float(lines[0]) if len(lines) == 1 else 0.0)
    key = next((name for name in (*FIRST, *facts.reference) if name in facts.reference), None)
    sizes = dict[str, float]()
    for row in rows:
        held = facts.reference if abs(row.frequency - tone) < SAME_FREQUENCY * tone else {}
        row["distance"] = {reference: abs(row.impedance - value) for reference, value in held.items()}
        row["model_error"] = errors[row.model]
        size = row.distance.get(key, abs(row.level_check or 0.0))
        sizes[row.model] = max(sizes.get(row.model, 0.0), size)
    referred, checked = any(row.distance for row in rows), rows[0].level_check is not None
    return Study(
        title=facts.title or facts.name,
        averaging=averaging,
        level=None if rows[0].low is None else chosen.interval,
        sorted_by=f"|Z - {key}|" if referred else "|level check|" if checked else "as given",
        references=dict(facts.reference) if referred else {},
        rows=tuple(sorted(rows, key=lambda row: (row.frequency, sizes[row.model]))),
        level_check_words=found.level_check_words,
        notes=tuple(notes),
    )
