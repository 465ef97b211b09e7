"""The answer of impedance maps: one, or several that belong together."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.records.level_check import FAILS, INCONCLUSIVE, PASSES
from torchliner.records.summaries import frequency_words, shape_words
from torchliner.report.answer import (
    Answer,
    Grid,
    Picture,
    difference_grid,
    difference_row,
    impedance_words,
    plain_of,
    row_words,
)
from torchliner.report.curves import ORDERS, alongside_at, draw_along_x, draw_spectrum
from torchliner.report.maps import draw_map, over_surface, probes_table
from torchliner.report.numbers import (
    case_title,
    impedance_along_x,
    impedance_over_frequency,
    interval_words,
    labels_of,
    main_of,
)
from torchliner.report.planes import draw_complex_plane, known_of
from torchliner.report.table import STATISTICAL, Bounds, Table, if_known, table_of
from torchliner.studies.validation import nearest_case
from torchliner.velocity.background import background_words

SHARES = ("share", "share_low", "share_high")  # of the incoherent velocity
UNBOUNDED = dict.fromkeys(("low", "high"))
MEANINGS = (
    "Admittance: each probe is driven by its own velocity, and the admittance is averaged over the probes. Velocity: "
    "the velocity is averaged over each cell. Phase-locked: only what of the velocity is periodic with the tone is "
    "averaged over the cell. The spread is that over probes, no uncertainty."
)
CSV = "height,frequency,averaging,impedance,low,high,spread,coherence,incident_level"
NULL_TEST = "Null test: the wall is hard and has no liner; the values show how this model responds to such a velocity."
Row = dict[str, Any]


def of_maps(results: Sequence[ImpedanceMap], source: Path | None = None) -> Answer:
    """Z with its interval and level check, a row a run and frequency; all averagings; what is known from elsewhere."""
    first, several, labels = results[0], len(results) > 1, labels_of(results)
    rows = [row | {"run": label} for one, label in zip(results, labels, strict=True) for row in rows_of(one)]
    heights = {one.height for one in results}
    place = "height," if several and len(heights) == len(results) else "run," * several
    interval = ",statistical interval" * (first.level is not None)
    shown = f"{place}frequency,averaging,impedance{interval}{if_known(rows, 'level check')}"
    csv = f"{'run,' * several}{CSV}{if_known(rows, 'level check')}"
    answers = [row for row in rows if row["averaging"] == first.averaging]
    others = [row for row in rows if row["averaging"] != first.averaging]
    brief = table_of(answers if several or len(answers) > 1 else [], shown)
    main, grids = main_of(first), list[Grid]()
    for one, label in zip(results, labels, strict=True):
        for each in (_matched(one), _cells(one, main_of(one)), _compared(one)):
            end, words = (f"-{len(grids)}", f" {label}.") if several else ("", "")
            grids.append(Grid(each.name + end, each.caption + words, each.table))
    verdicts = [state_of(one, i) for one in results for i in range(len(one.frequency))]
    nearest = [line[:1].upper() + line[1:] + "." for line in dict.fromkeys(map(nearest_case, results)) if line]
    hard = any(one.choices.get("surface") == "hard wall" for one in results)
    name = (case_title(first) if several else first.title) or (source.name if source else "")
    return Answer(
        title=("Impedance map" + "s" * several) + (f": {name}" if name else ""),
        lines=[
            *([] if several else [_line(first, main)]),
            *([] if several else [level_line(first, main)]),
            *dict.fromkeys(line for one in results for line in _known_lines(one)),
            *(dict.fromkeys(f"Level check: {one.level_check_words}." for one in results) if several else []),
            *([NULL_TEST] if hard else []),
        ],
        table=table_of([*answers, *others], f"{shown},spread,coherence", csv),
        brief=brief,
        caption=f"Impedance of the whole liner, Z = R + jX over ρc. {MEANINGS}",
        plain=[_plain(one) for one in results],
        grids=grids,
        remarks=[*nearest, _basis(first)],
        notes=[note for one in results for note in (*one.notes, *(n for each in one.alongside for n in each.notes))],
        step=_step(first, verdicts),
        state=next((word for word in (FAILS, INCONCLUSIVE, PASSES) if word in verdicts), "")
        if several
        else state_of(first, main),
        pictures=[] if several else _pictures(first, main),
        results=[each for one in results for each in (one, *one.alongside)],
        facts=_facts(first),
        source=source,
    )


def rows_of(result: ImpedanceMap) -> list[Row]:
    """A row a frequency and averaging, the answer's first: Z, the ends of its interval, its level check."""
    check, rows = result.level_check, []
    flat = result.coherence.reshape(-1, len(result.frequency))
    for i, frequency in enumerate(result.frequency.tolist()):
        about = {"spread": complex(result.liner_spread[i]), "coherence": float(flat[:, i].nanmedian())}
        # The median over probes: a mean of complex waves would cancel along a grazing one.
        about["incident_level"] = float(result.inferred_incident_level[..., i].nanmedian())
        for name in sorted(result.averagings, key=lambda each: each != result.averaging):
            low, high = result.bounds_of_liner(name, i) or (None, None)
            row: Row = {"height": result.height, "frequency": frequency, "averaging": name}
            row |= {"impedance": complex(result.liner[name].impedance[i]), "low": low, "high": high}
            rows.append(row | {"level check": None if check is None else check.words(name, i)} | about)
    return rows


def _line(result: ImpedanceMap, index: int) -> str:
    """Z of the liner and its interval."""
    value, frequency = complex(result.answer[index]), float(result.frequency[index])
    if value != value:
        return f"No impedance at {frequency:g} Hz: every probe counts as wall or was left out."
    what = "whole liner"
    if result.choices.get("surface") == "hard wall":
        what = "null test without any liner"
    bounds = result.bounds_of_liner(result.averaging, index)
    interval = ", no interval" if bounds is None else f"; the interval is {STATISTICAL}"
    words = impedance_words(value, bounds, result.level)
    return f"{words} in units of ρc at {frequency:g} Hz, {what}, averaging {result.averaging}{interval}."


def level_line(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """'Level check fails: -1.93 dB off ...', or why there is none."""
    check, words = result.level_check, result.level_check_words
    if check is None:
        return f"Level check: {words}."
    verdict = check.verdict(check.averaging, index)
    if not verdict:
        return "Level check: no pressure is known at this frequency."
    level = check.words(check.averaging, index).removesuffix(verdict).strip()
    return f"Level check {'is ' * (verdict == INCONCLUSIVE)}{verdict}: {level} {words}."


def state_of(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """Of the level check of the answer; "" without one."""
    check = result.level_check
    return "" if check is None else check.verdict(check.averaging, index)


def _known_lines(result: ImpedanceMap) -> list[str]:
    """What is level-matched, and which turbulence acted, each where there is one."""
    found, lines, choices = result.level_matched, list[str](), result.choices
    for row in matched_rows(result):
        assert found is not None
        share = f"share of the incoherent velocity {row['share']:.2g}"
        where = f"at {row['frequency']:g} Hz, measured by pressure and velocity with the model's phase"
        lines.append(f"Level-matched {row_words(row, result.level)} {where}; {share}.")
    if background := background_words(choices):
        lines.append(f"{background[:1].upper()}{background[1:]}.")
    elif (ratio := choices.get("velocity_ratio")) is not None:
        lines.append(f"Velocity ratio |V1|/(φ M c) = {ratio:.2g}.")
    return lines


def _step(result: ImpedanceMap, verdicts: Sequence[str]) -> str:
    """What to do next."""
    check = result.level_check
    if result.choices.get("surface") == "hard wall":
        return ""
    if check is None or not any(verdicts):
        return "check the level: state incident_level, or give wall pressures (--wall-pressure)"
    if FAILS in verdicts:
        index = next(i for i in range(len(result.frequency)) if state_of(result, i) == FAILS) if check.failed else 0
        others = [name for name in check.averagings if check.verdict(name, index) == PASSES]
        if others:
            return f"averaging {' and '.join(others)} passes the level check: take it"
        quiet = "" if result.choices.get("background") else "give a run without sound (--background), "
        return f"no averaging passes: {quiet}calibrate the model, check the level, or take another height"
    if INCONCLUSIVE in verdicts:
        return "the record is too short to tell: take a longer one"
    return "torchliner audit shows how far each open choice moves Z"


def known_pairs(result: ImpedanceMap, index: int) -> list[tuple[str, complex, Bounds | None]]:
    """What is known from elsewhere: name, Z, interval."""
    found: dict[str, tuple[complex, Bounds | None]] = {name: (z, None) for name, z in known_of([result], index).items()}
    for other, f in alongside_at([result], index):
        for end, order in ORDERS:
            found[f"{other.name}, {order}"] = (found[f"{other.name}, {order}"][0], other.bounds_of_liner(end, f))
    return [(name, *pair) for name, pair in found.items()]


def _compared(result: ImpedanceMap) -> Grid:
    """A row a reference and frequency."""
    return difference_grid(
        [
            difference_row(
                frequency, complex(result.answer[i]), result.bounds_of_liner(result.averaging, i), name, z, its
            )
            for i, frequency in enumerate(result.frequency.tolist())
            for name, z, its in known_pairs(result, i)
        ]
    )


def _cells(result: ImpedanceMap, index: int) -> Grid:
    """Each cell: Z in the averaging of the answer, its interval, its level check."""
    found, check, rows = result.cells[result.averaging], result.level_check, []
    for cell, z in enumerate(found.impedance[:, index].tolist()):
        low, high = (None, None) if found.interval is None else found.interval.bounds(cell, index)
        level = None
        if check is not None:
            level = check.cells.at(check.averagings.index(result.averaging), cell, index)["level"]
        place = {"cell": cell, "x": float(result.cell_x[cell]), "z": float(result.cell_z[cell])}
        rows.append(place | {"impedance": z, "low": low, "high": high, "level_check": level})
    caption = f"Each cell, averaging {result.averaging}, {float(result.frequency[index]):g} Hz."
    interval = ",statistical interval" * (found.interval is not None)
    return Grid("cells", caption, table_of(rows, f"cell,x,z,impedance{interval}{if_known(rows, 'level_check')}"))


def _matched(result: ImpedanceMap) -> Grid:
    """Z that agrees with the known level."""
    level = "" if result.level_matched is None else f", level +- {result.level_matched.uncertainty:g} dB"
    caption = f"Level-matched: |Z + 1| or |Z| measured by pressure and velocity, the phase by the model{level}."
    return Grid("level-matched", caption, table_of(matched_rows(result), "frequency,impedance,interval,share"))


def matched_rows(result: ImpedanceMap) -> list[Row]:
    """The level-matched answer at each frequency that has one."""
    found, rows = result.level_matched, list[Row]()
    for i, frequency in enumerate(result.frequency.tolist() if found is not None else ()):
        if found is not None and math.isfinite(float(found.share[i])):
            row = {name: getattr(found, name)[i].tolist() for name in ("impedance", "low", "high", *SHARES)}
            unbounded = not math.isfinite(abs(row["low"] + row["high"]))
            rows.append({"height": result.height, "frequency": frequency} | row | (UNBOUNDED if unbounded else {}))
    return rows


def plain_matched(result: ImpedanceMap) -> Row | None:
    """For JSON."""
    found = result.level_matched
    return None if found is None else {"rows": matched_rows(result), "uncertainty": found.uncertainty}


def _basis(result: ImpedanceMap) -> str:
    """Conventions and what the numbers rest on."""
    choices, words = result.choices, "Z is p/(ρc v), exp(+jωt)"
    words += "".join(f", {name} {choices[name]}" for name in ("phase", "drive") if name in choices)
    if (ratio := choices.get("velocity_ratio")) is not None:
        words += f"; velocity ratio |V1|/(φ M c) {ratio:.2g}"
    words += f"; {background}" if (background := background_words(choices)) else ""
    if (error := choices.get("model_error")) is not None:
        words += f"; model-table error in R {error:.1e}"
    if result.level is not None:
        words += f"; {interval_words(result)} {STATISTICAL}: a jackknife over blocks of time, as the record is finite"
    return f"{words}."


def _facts(result: ImpedanceMap) -> list[tuple[str, str]]:
    stated = result.choices.get("liner") or {}
    facts = [
        ("liner", stated.get("name") or stated.get("model") or "not stated"),
        ("probes", shape_words(tuple(result.mean_velocity.shape), "probe")),
        ("cells", str(len(result.cell_x))),
        ("frequency", frequency_words(result.frequency)),
        ("rms of v over all probes", f"{float(result.velocity_rms.square().nanmean().sqrt()):.4g} m/s"),
        ("source side", result.source_side),
    ]
    known = [("height", result.height, "m"), ("incident level", result.incident_level, "dB"), ("Mach", result.mach, "")]
    return facts + [(what, f"{value:.6g} {unit}".strip()) for what, value, unit in known if value is not None]


def _plain(result: ImpedanceMap) -> Row:
    """For JSON; ``spread`` is that over probes, ``low`` and ``high`` bound the interval."""
    check = result.level_check
    checked = {"checked": check is not None, "words": result.level_check_words}
    return {
        "title": result.title,
        "averaging": result.averaging,
        "rows": rows_of(result),
        "reference": dict(result.reference),
        "compared": [dict(row) for row in _compared(result).table.rows],
        "level_matched": plain_matched(result),
        "level_check": checked if check is None else checked | check.plain(result.frequency.tolist()),
        "nearest_case": nearest_case(result) or None,
        "choices": plain_of(result.choices),
        "notes": [vars(note) for note in result.notes],
    }


def _pictures(result: ImpedanceMap, index: int) -> list[Picture]:
    """At the tone, and over frequency where there are several."""
    at = f"{float(result.frequency[index]):g} Hz"
    words = f"; bands and bars: {interval_words(result)}" if result.level is not None else ""
    found = []
    if len(result.frequency) > 1:
        caption = (
            f"Impedance of the whole liner over frequency{words}. The axes end before poles of Z; the CSV does not."
        )
        curves = impedance_over_frequency(result)
        found.append(Picture("spectrum", caption, partial(draw_spectrum, [result]), lambda: curves.table))
    if over_surface(result):
        caption = f"Resistance and reactance over ρc at each probe, {at}; colours from the 1st to the 99th percentile."
        draw: Any = partial(draw_map, result, frequency_index=index)
        found.append(Picture("map", caption, draw, lambda: probes_table(result, index)))
    if result.mean_velocity.numel() > 1:
        caption = f"Impedance along x at {at}, the admittance averaged over z{words}."
        draw = partial(draw_along_x, [result], frequency_index=index)
        found.append(Picture("along-x", caption, draw, lambda: impedance_along_x(result, index).table))
    caption = f"Z over ρc in the complex plane at {at}; crosses: intervals of R and of X."
    draw = partial(draw_complex_plane, result, index=index)
    return [*found, Picture("complex-plane", caption, draw, lambda: _plane_table(result, index))]


def _plane_table(result: ImpedanceMap, index: int) -> Table:
    """Cells, averagings of the liner, references and other methods, with intervals where known."""
    cells = result.cells[result.averaging].impedance[:, index].tolist()
    rows: list[Row] = [{"what": "cell", "name": str(i), "impedance": z} for i, z in enumerate(cells)]
    for name, liner in result.liner.items():
        ends = result.bounds_of_liner(name, index) or (None, None)
        rows.append(
            {"what": "liner", "name": name, "impedance": complex(liner.impedance[index])}
            | dict(zip(("low", "high"), ends, strict=True))
        )
    rows += [{"what": "known", "name": name, "impedance": z} for name, z in known_of([result], index).items()]
    return table_of(rows)
