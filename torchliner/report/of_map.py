"""The answer of impedance maps: one, or several that belong together."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

import torch

from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.records.level_check import FAILS, INCONCLUSIVE, PASSES
from torchliner.report import numbers
from torchliner.report.answer import Answer, Grid, Picture, impedance_words, picture, row_words
from torchliner.report.curves import ORDERS, alongside_at, draw_along_x, draw_spectrum
from torchliner.report.maps import draw_map, over_surface, probes_table
from torchliner.report.planes import draw_complex_plane, known_of
from torchliner.report.table import STATISTICAL, Row, rows_of, table_of
from torchliner.studies.validation import nearest_case
from torchliner.velocity.background import background_words

MATCHED = "level-matched"
NULL_TEST = "Null test: the wall is hard and has no liner; the values show how this model responds to such a velocity."


def of_maps(results: Sequence[ImpedanceMap], source: Path | None = None) -> Answer:
    """Z with its interval and level check, a row a run and frequency; all averagings; what is known from elsewhere."""
    first, several, main = results[0], len(results) > 1, numbers.main_of(results[0])
    rows = [
        ({"run": label} if several else {}) | row
        for one, label in zip(results, numbers.labels_of(results), strict=True)
        for row in map_rows(one)
    ]
    answers = [row for row in rows if row["averaging"] in (first.averaging, MATCHED)]
    shown = "run,frequency,averaging,impedance,interval,level check,share"
    lines = [f"Level check: {one.level_check_words}." for one in results]
    if not several:
        near = nearest_case(first, main, brief=True)
        lines = [_line(first, main), *([near] if near else []), level_line(first, main)]
    verdicts = [state_of(one, i) for one in results for i in ([main] if not several else range(len(one.frequency)))]
    state = next((word for word in (FAILS, INCONCLUSIVE, PASSES) if word in verdicts), "")
    name = (numbers.case_title(first) if several else first.title) or (source.name if source else "")
    return Answer(
        title=("Impedance map" + "s" * several) + (f": {name}" if name else ""),
        lines=[*dict.fromkeys([*lines, *(line for one in results for line in _known_lines(one))])],
        table=table_of(rows, f"{shown},spread,coherence"),
        brief=table_of(answers if several or len(answers) > 1 else [], shown),
        caption="Z = R + jX of the whole liner over ρc, by averaging, beside what is known from elsewhere; the "
        f"interval is {STATISTICAL}; the spread is that over probes, no uncertainty.",
        grids=[Grid(f"cells{i or ''}", "Each cell.", table_of(_cells(one), CELLS)) for i, one in enumerate(results)],
        remarks=[*dict.fromkeys(filter(None, map(nearest_case, results)))],
        notes=[
            note for one in results for notes in (one.notes, *(each.notes for each in one.alongside)) for note in notes
        ],
        step=_step(first, state, main),
        state=state,
        pictures=[] if several else _pictures(first, main),
        results=[each for one in results for each in (one, *one.alongside)],
        source=source,
    )


def map_rows(result: ImpedanceMap) -> list[Row]:
    """A row a frequency and averaging, the answer's first, then level-matched and known impedances."""
    check, matched, rows = result.level_check, result.level_matched, list[Row]()
    flat = result.coherence.reshape(-1, len(result.frequency))
    for i, frequency in enumerate(result.frequency.tolist()):
        about: Row = {"height": result.height, "frequency": frequency}
        for name in sorted(result.averagings, key=lambda each: each != result.averaging):
            low, high = result.bounds_of_liner(name, i) or (None, None)
            row: Row = {"averaging": name, "impedance": complex(result.liner[name].impedance[i])}
            row |= {"low": low, "high": high, "spread": complex(result.liner_spread[i])}
            # The median over probes: a mean of complex waves would cancel along a grazing one.
            row |= {"incident_level": float(result.inferred_incident_level[..., i].nanmedian())}
            row |= {"coherence": float(flat[:, i].nanmedian())}
            if check is not None:
                row |= {"level check": check.words(name, i), "verdict": check.verdict(name, i)}
                row |= check.liner.at(check.averagings.index(name), i)
            rows.append(about | row)
        if matched is not None and bool(matched.share[i].isfinite()):
            names = ("impedance", "low", "high", "share")
            rows.append(about | {"averaging": MATCHED} | {name: getattr(matched, name)[i].tolist() for name in names})
        its = {
            f"{other.name}, {order}": other.bounds_of_liner(end, f)
            for other, f in alongside_at([result], i)
            for end, order in ORDERS
        }
        for name, z in known_of([result], i).items():
            low, high = its.get(name) or (None, None)
            rows.append(about | {"averaging": name, "impedance": z, "low": low, "high": high})
    return rows


def _line(result: ImpedanceMap, index: int) -> str:
    """Z of the liner and its interval."""
    value, at = complex(result.answer[index]), f"at {float(result.frequency[index]):g} Hz"
    if value != value:
        return f"No impedance {at}: every probe counts as wall or was left out."
    bounds = result.bounds_of_liner(result.averaging, index)
    what = "null test without any liner" if result.choices.get("surface") == "hard wall" else "whole liner"
    end = ", no interval" if bounds is None else f"; the interval is {STATISTICAL}"
    words = impedance_words(value, bounds, result.level)
    return f"{words} in units of ρc {at}, {what}, averaging {result.averaging}{end}."


def level_line(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """'Level check fails: -1.93 dB off ...', or why there is none."""
    check, verdict = result.level_check, state_of(result, index)
    if check is None:
        return f"Level check: {result.level_check_words}."
    if not verdict:
        return "Level check: no pressure is known at this frequency."
    level = check.words(check.averaging, index).removesuffix(verdict).strip()
    return f"Level check {'is ' * (verdict == INCONCLUSIVE)}{verdict}: {level} {result.level_check_words}."


def state_of(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """Of the level check of the answer; "" without one."""
    check = result.level_check
    return "" if check is None else check.verdict(check.averaging, index)


def _known_lines(result: ImpedanceMap) -> list[str]:
    """The level-matched Z, the turbulence that acted, a null test: each where there is one."""
    choices = result.choices
    lines = [
        f"Level-matched {row_words(row, result.level)} at {row['frequency']:g} Hz, measured by pressure and velocity "
        f"with the model's phase; share of the incoherent velocity {row['share']:.2g}."
        for row in map_rows(result)
        if row["averaging"] == MATCHED
    ]
    if background := background_words(choices):
        lines.append(f"{background[:1].upper()}{background[1:]}.")
    elif (ratio := choices.get("velocity_ratio")) is not None:
        lines.append(f"Velocity ratio |V1|/(φ M c) = {ratio:.2g}.")
    return lines + [NULL_TEST] * (choices.get("surface") == "hard wall")


def _step(result: ImpedanceMap, state: str, index: int) -> str:
    """What to do next."""
    check = result.level_check
    if result.choices.get("surface") == "hard wall":
        return ""
    if check is None or not state:
        return "check the level: state incident_level, or give wall pressures (--wall-pressure)"
    if state == FAILS:
        if others := [name for name in check.averagings if check.verdict(name, index) == PASSES]:
            return f"averaging {' and '.join(others)} passes the level check: take it"
        quiet = "" if result.choices.get("background") else "give a run without sound (--background), "
        return f"no averaging passes: {quiet}calibrate the model, check the level, or take another height"
    if state == INCONCLUSIVE:
        return "the record is too short to tell: take a longer one"
    return "torchliner audit shows how far each open choice moves Z"


CELLS = "cell,x,z,frequency,impedance,interval,level_check"


def _cells(result: ImpedanceMap) -> list[Row]:
    """Each cell: Z in the averaging of the answer, its interval, its level check."""
    found, check, x = result.cells[result.averaging], result.level_check, result.cell_x[:, None]
    return rows_of(
        cell=torch.arange(len(x))[:, None],
        x=x,
        z=result.cell_z[:, None],
        frequency=result.frequency,
        impedance=found.impedance,
        interval=found.interval,
        level_check=None if check is None else check.cells.level[check.averagings.index(result.averaging)],
    )


def _pictures(result: ImpedanceMap, index: int) -> list[Picture]:
    """At the tone, and over frequency where there are several."""
    at, found = f"{float(result.frequency[index]):g} Hz", list[Picture]()
    bars = f"; bands and bars: {numbers.interval_words(result)}" if result.level is not None else ""
    if len(result.frequency) > 1:
        words = f"Impedance of the whole liner over frequency{bars}. The axes end before poles of Z."
        draw = partial(draw_spectrum, [result])
        found.append(Picture("spectrum", words, draw, lambda: numbers.impedance_over_frequency(result).table))
    if over_surface(result):
        words = f"Resistance and reactance over ρc at each probe, {at}; colours from the 1st to the 99th percentile."
        draw_surface = partial(draw_map, result, frequency_index=index)
        found.append(Picture("map", words, draw_surface, lambda: probes_table(result, index)))
    if result.mean_velocity.numel() > 1:
        words = f"Impedance along x at {at}, the admittance averaged over z{bars}."
        draw = partial(draw_along_x, [result], frequency_index=index)
        found.append(Picture("along-x", words, draw, lambda: numbers.impedance_along_x(result, index).table))
    words = f"Z over ρc in the complex plane at {at}; crosses: intervals of R and of X."
    near = [row for row in (*map_rows(result), *_cells(result)) if row["frequency"] == float(result.frequency[index])]
    return [*found, picture("complex-plane", words, partial(draw_complex_plane, result, index=index), near)]
