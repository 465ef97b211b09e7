"""The page of an impedance map."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from torchliner.records import ImpedanceLine, ImpedanceMap
from torchliner.records.level_check import INCONCLUSIVE
from torchliner.records.summaries import frequency_words, shape_words
from torchliner.report import figures
from torchliner.report.alongside import differences
from torchliner.report.cell_figures import FACES
from torchliner.report.map_table import MATCHED, NULL_TEST
from torchliner.report.numbers import (
    COMPLEX_PART,
    impedance_along_x,
    impedance_over_frequency,
    interval_words,
    part_of,
)
from torchliner.report.page.blocks import Block, Facts, Figure, Grid, Section, Text, shown
from torchliner.report.page.complex_plane import draw_complex_plane, known_of, plane_table
from torchliner.report.page.render import Page
from torchliner.report.page.sections import FOOTER, asked, changed, citation, origin, warned
from torchliner.report.page.tables import FREQUENCY, bounded, compared, difference, impedance_columns, off
from torchliner.report.table import Column, Table, format_bounds, format_complex
from torchliner.report.typesetting import typeset
from torchliner.studies.reference_cases import nearest_case
from torchliner.velocity.background import background_words

MOST_SURFACE, MOST_LINE = 40_000, 4_000  # probes that are drawn: over (x, z); on a line or scattered
PROBES = ("mean_velocity", "velocity_rms", "velocity_amplitude", "coherence", "phase_rule", "wall")
MEANINGS = (
    "Admittance: each probe is driven by its own velocity, and the admittance is averaged over the probes. Velocity: "
    "the velocity is averaged over each cell. Phase-locked: only what of the velocity is periodic with the tone is "
    "averaged over the cell."
)


def page_of_map(result: ImpedanceMap, path: Path | None = None) -> Page:
    """Answer, warnings, pictures at the tone, comparison, choices, provenance."""
    main, name = main_of(result), result.title or (path.name if path else "")
    drawn, left_out = thin(_drawable(result))
    frequency = float(result.frequency[main])
    pictures: list[Block] = [Text(left_out)] if left_out else []
    if len(result.frequency) > 1:
        pictures.append(Text(f"Drawn at {frequency:g} Hz, one of {len(result.frequency)} frequencies."))
    if figures.over_surface(drawn, main):
        pictures.append(_over_liner(drawn, main))
    if drawn.mean_velocity.numel() > 1:
        pictures.append(_along_x(drawn, main))
    caption = f"Z over ρc in the complex plane at {frequency:g} Hz. Crosses: statistical intervals of R and of X."
    pictures.append(Figure("complex-plane", draw_complex_plane(drawn, main), caption, plane_table(result, main)))
    if len(result.frequency) > 1:
        pictures.append(_spectrum(drawn))
    others = [note for each in result.alongside for note in each.notes]
    stated = result.choices.get("liner") or {}
    facts: list[tuple[str, str]] = [
        ("liner", shown(stated.get("name") or stated.get("model") or "not stated")),
        ("probes", shape_words(tuple(result.mean_velocity.shape), "probe")),
        ("cells", str(len(result.cell_x))),
        ("frequency", frequency_words(result.frequency)),
        ("rms of v over all probes", f"{float(result.velocity_rms.square().nanmean().sqrt()):.4g} m/s"),
        ("source side", result.source_side),
    ]
    for what, value, unit in (
        ("height", result.height, "m"),
        ("incident level", result.incident_level, "dB"),
        ("bulk Mach number", result.mach, ""),
        ("velocity ratio |V1|/(phi M c)", result.choices.get("velocity_ratio"), ""),
    ):
        facts += [] if value is None else [(what, f"{value:.6g} {unit}".strip())]
    return Page(
        f"Impedance map: {name}" if name else "Impedance map",
        _sentence(result, main),
        state(result, main),
        [
            Section("answers", "Answer", _answers(result)),
            warned([*changed(result, *result.alongside), *result.notes, *others]),
            Section("pictures", "Pictures", pictures),
            Section("cells-section", "Cells", _cells(result, main)),
            Section("comparison", "Comparison", _compared(result, main)),
            asked(result.choices, Facts(facts)),
            origin([result, *result.alongside], path),
            citation(),
        ],
        FOOTER,
    )


def main_of(result: ImpedanceMap) -> int:
    """Index of the frequency of the data's tone, else of that at which v is most coherent."""
    if result.tone is not None:
        return result.tone
    flat = result.coherence.reshape(-1, len(result.frequency)).double()
    median = flat.nanmedian(0).values.nan_to_num(-1)
    return int(median.argmax()) if bool((median > 0).any()) else 0


def _sentence(result: ImpedanceMap, index: int) -> str:
    """Z of the liner, its interval and its level check."""
    value, frequency = complex(result.answer[index]), float(result.frequency[index])
    if value != value:
        return f"No impedance at {frequency:g} Hz: every probe counts as wall or was left out."
    what = "the impedance of the whole liner is"
    if result.choices.get("surface") == "hard wall":
        what = "above a hard wall, a null test without any liner, the model gives"
    bounds = result.bounds_of_liner(result.averaging, index)
    interval = "no statistical interval" if bounds is None else f"{interval_words(result)}: {format_bounds(bounds)}"
    return typeset(
        f"At {frequency:g} Hz {what} Z = {format_complex(value)} in units of ρc (averaging {result.averaging}; "
        f"{interval}); {level_check_clause(result, index)}."
    )


def level_check_clause(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """'the level check fails: -1.93 dB off ...', or why there is none."""
    check, words = result.level_check, shown(result.level_check_words)
    if check is None:
        return f"level check: {words}"
    verdict = check.verdict(check.averaging, index)
    if not verdict:
        return "level check: no pressure is known at this frequency"
    level = check.words(check.averaging, index).removesuffix(verdict).strip()
    return f"the level check {'is ' * (verdict == INCONCLUSIVE)}{verdict}: {level} {words}"


def state(result: ImpedanceMap | ImpedanceLine, index: int) -> str:
    """Of the level check of the answer; "" without one."""
    check = result.level_check
    return "" if check is None else check.verdict(check.averaging, index)


def _answers(result: ImpedanceMap) -> list[Block]:
    """A row an averaging and frequency, that of the answer first."""
    check, rows = result.level_check, []
    for i, frequency in enumerate(result.frequency.tolist()):
        for name in sorted(result.averagings, key=lambda each: each != result.averaging):
            z, bounds = complex(result.liner[name].impedance[i]), result.bounds_of_liner(name, i)
            level = "-" if check is None else typeset(check.words(name, i))
            label = f"{name} (the answer)" if name == result.averaging else name
            row = {"frequency": frequency, "averaging": name, "shown": label, "level check": level}
            rows.append(row | bounded(z, bounds))
        matched = result.level_matched
        if matched is not None and math.isfinite(float(matched.share[i])):
            ends = (complex(matched.low[i]), complex(matched.high[i])) if result.level is not None else None
            used = f"used; {float(matched.share[i]):.3g} times the incoherent velocity"
            row = {"frequency": frequency, "averaging": "level-matched", "shown": "level-matched", "level check": used}
            rows.append(row | bounded(complex(matched.impedance[i]), ends))
    columns = [FREQUENCY, Column("averaging"), Column("", "shown", "averaging")]
    columns += impedance_columns(bounds=result.level is not None)
    columns.append(Column("level check", heading="" if check is None else "level check"))
    caption = f"Impedance of the whole liner over ρc, Z = R + jX. {MEANINGS}"
    if result.level is not None:
        caption += f" {interval_words(result)}: by a jackknife over blocks of time, because the record is finite."
    if result.level_matched is not None:
        caption += f" Level-matched: {MATCHED}."
    if words := background_words(result.choices):
        caption += f" Phase-locked: {words}."
    null: list[Block] = [Text(NULL_TEST)] if result.choices.get("surface") == "hard wall" else []
    return [*null, Grid("answer-table", caption, Table(rows, columns, ".9g"))]


def _over_liner(result: ImpedanceMap, index: int) -> Block:
    """R and X over (x, z)."""
    shape, x, z = tuple(result.mean_velocity.shape), result.x, result.z
    if len(shape) == 2:
        x = None if x is None else x.repeat(shape[0])
        z = None if z is None else z.repeat_interleave(shape[1])
    columns = {f"{axis} (m)": at.tolist() for axis, at in (("x", x), ("z", z)) if at is not None}
    for part in COMPLEX_PART:
        columns[f"{part} (rho c)"] = part_of(result.impedance[..., index], part).reshape(-1).tolist()
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    caption = (
        f"Resistance and reactance over ρc at each probe, {float(result.frequency[index]):g} Hz. The colours run from "
        "the 1st to the 99th percentile of the probes; what lies beyond has the colour of the end."
    )
    drawn = figures.draw_map(result, None, index)
    return Figure("map", drawn, caption, Table(rows, [Column(name) for name in columns], ".6g"))


def _along_x(result: ImpedanceMap, index: int) -> Block:
    """R and X along the liner, cells and references."""
    curves, bands = impedance_along_x(result, index), interval_words(result)
    faces = [f"{FACES[name]}, {name}" for name in result.averagings if name != result.averaging]
    caption = (
        f"Impedance along x at {float(result.frequency[index]):g} Hz, the admittance averaged over z. Cells: "
        f"{'; '.join([f'filled markers, {result.averaging}', *faces])}."
        + (f" Bands and bars: {bands}." if bands else "")
    )
    return Figure("along-x", figures.draw_along_x([result], None, index), caption, curves.table)


def _spectrum(result: ImpedanceMap) -> Block:
    """R and X over frequency."""
    bars = interval_words(result)
    caption = (
        f"Impedance of the whole liner over frequency: solid, {result.averaging}. Shaded: middle half of the probes."
        + (f" Bars: {bars}." if bars else "")
        + " The axis leaves out poles of Z; the CSV does not."
    )
    return Figure("spectrum", figures.draw_spectrum([result]), caption, impedance_over_frequency(result).table)


def _cells(result: ImpedanceMap, index: int) -> list[Block]:
    """Each cell: Z in the averaging of the answer, its interval, its level check."""
    found, check, rows = result.cells[result.averaging], result.level_check, []
    for cell, z in enumerate(found.impedance[:, index].tolist()):
        bounds = None if found.interval is None else found.interval.bounds(cell, index)
        level = None
        if check is not None:
            level = check.cells.at(check.averagings.index(result.averaging), cell, index)["level"]
        place = {"x": float(result.cell_x[cell]), "z": float(result.cell_z[cell])}
        rows.append({"cell": cell, "level check": level} | place | bounded(z, bounds))
    columns = [Column("cell", heading="cell", text="d")]
    columns += [Column(f"{axis} (m)", axis, f"{axis} (mm)", ".2f", 1e3) for axis in "xz"]
    columns += impedance_columns(bounds=found.interval is not None)
    if check is not None:
        columns.append(Column("level check (dB)", "level check", "level check (dB)", "+.2f"))
    caption = f"Each cell over ρc, averaging {result.averaging}, {float(result.frequency[index]):g} Hz."
    return [Grid("cells", caption, Table(rows, columns, ".9g"))] if rows else []


def _compared(result: ImpedanceMap, main: int) -> list[Block]:
    """A row a reference and frequency; the nearest reference case."""
    rows = []
    for i, frequency in enumerate(result.frequency.tolist()):
        mine = bounded(complex(result.answer[i]), result.bounds_of_liner(result.averaging, i))
        seen = {row["between"].partition(" less ")[2]: row for row in differences([result], i)}
        for name, value in known_of(result, i).items():
            both = seen.get(name, {})
            bounds = off(mine, value) if both.get("low") is None else (both["low"], both["high"])
            rows.append(difference(frequency, mine, shown(name), value, bounds))
    caption = (
        f"The answer (averaging {result.averaging}) less what is known from elsewhere. The interval is the joint "
        "statistical one where both have one, else the map's alone."
    )
    line = nearest_case(result, main)
    nearest = [Text(typeset(shown(line[:1].upper() + line[1:])))] if line else []
    return [compared(rows, caption), *nearest]


def _drawable(result: ImpedanceMap) -> ImpedanceMap:
    """Names from the file as printable text, not as formulas of the drawing library."""

    def printed(text: str) -> str:
        return shown(text).replace("$", r"\$")

    return dataclasses.replace(
        result,
        title=printed(result.title),
        reference={printed(name): value for name, value in result.reference.items()},
        alongside=tuple(dataclasses.replace(each, name=printed(each.name)) for each in result.alongside),
    )


def thin(result: ImpedanceMap) -> tuple[ImpedanceMap, str]:
    """Every n-th probe, of rows and of columns of a grid, and what was left out; averages stay those of all."""
    shape = tuple(result.mean_velocity.shape)
    most = MOST_SURFACE if len(shape) == 2 and min(shape) > 1 else MOST_LINE
    steps = [1] * len(shape)
    while math.prod(-(-n // s) for n, s in zip(shape, steps, strict=True)) > most:
        steps[max(range(len(shape)), key=lambda axis: shape[axis] / steps[axis])] += 1
    if max(steps, default=1) == 1:
        return result, ""
    cut = tuple(slice(None, None, step) for step in steps)
    fields: Any = {name: value[cut] for name in PROBES if (value := getattr(result, name)) is not None}
    left = dataclasses.replace(
        result,
        **fields,
        probes={name: each.map(lambda value: value[cut]) for name, each in result.probes.items()},
        along_x={name: each.map(lambda value: value[cut[-1]]) for name, each in result.along_x.items()},
        x=None if result.x is None else result.x[cut[-1]],
        z=None if result.z is None else result.z[cut[0]],
    )
    few = left.mean_velocity.numel()
    return left, (
        f"Drawn and listed: {few:,} of {math.prod(shape):,} probes, one of each {' x '.join(map(str, steps))}; all of "
        "them are in the map's file, and all averages are of all."
    )


def one_of(values: Sequence[float]) -> str:
    """'900 Hz' or '900 Hz, the first of 3 frequencies'."""
    return f"{values[0]:g} Hz" + (f", the first of {len(values)} frequencies" if len(values) > 1 else "")
