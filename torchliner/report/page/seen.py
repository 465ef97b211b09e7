"""Pictures of a map: over the liner, along x, in the complex plane, over frequency."""

from __future__ import annotations

import torch

from torchliner.records import ImpedanceMap
from torchliner.report import figures
from torchliner.report.cell_figures import FACES
from torchliner.report.numbers import (
    COMPLEX_PART,
    impedance_along_x,
    impedance_over_frequency,
    interval_words,
    part_of,
)
from torchliner.report.page.blocks import Block, Figure, Text
from torchliner.report.page.complex_plane import draw_complex_plane, plane_table
from torchliner.report.page.subject import MapSubject, at_probes
from torchliner.report.table import Column, Table, format_complex
from torchliner.report.typesetting import typeset

FEW = 2  # probes that make a line


def over_liner(subject: MapSubject) -> list[Block]:
    """R and X over (x, z), where there is a surface."""
    result, left_out = subject.thinned
    blocks: list[Block] = []
    for i in subject.drawn:
        if not figures.over_surface(result, i):
            continue
        shares = [at_probes(getattr(subject.result, part)[..., i]) for part in COMPLEX_PART]
        low, middle, high = zip(*(_percentiles(each) for each in shares), strict=True)
        frequency = float(result.frequency[i])
        alt = (
            f"Two maps over the liner at {frequency:g} Hz: resistance with median {middle[0]:.3f}, "
            f"1 to 99 % of the probes {low[0]:.3f} to {high[0]:.3f}; reactance with median "
            f"{middle[1]:.3f}, {low[1]:.3f} to {high[1]:.3f}."
        )
        caption = (
            f"Resistance and reactance over ρc at each probe, {frequency:g} Hz. The colours run "
            f"from the 1st to the 99th percentile of the probes, R {low[0]:.3f} to {high[0]:.3f} "
            f"and X {low[1]:.3f} to {high[1]:.3f}; what lies beyond has the colour of the end."
        )
        drawn = figures.draw_map(result, None, i)
        blocks.append(Figure(f"map-{i}", drawn, typeset(alt), typeset(caption),
                             _probe_table(result, i)))  # fmt: skip
    if not blocks:
        count = subject.result.mean_velocity.numel()
        words = "one probe has" if count == 1 else f"{count:,} probes on a line have"
        return [Text(f"No map: {words} no surface.")]
    return _with_words(blocks, subject, left_out)


def _percentiles(values: torch.Tensor) -> list[float]:
    if not len(values):
        return [torch.nan] * 3
    ordered = values.sort().values
    return [float(ordered[round(q * (len(ordered) - 1))]) for q in (0.01, 0.5, 0.99)]


def _probe_table(result: ImpedanceMap, index: int) -> Table:
    """A row a probe."""
    shape = tuple(result.mean_velocity.shape)
    values = {part: part_of(result.impedance[..., index], part).reshape(-1).tolist()
              for part in COMPLEX_PART}  # fmt: skip
    x, z = result.x, result.z
    if len(shape) == 2:
        x = None if x is None else x.repeat(shape[0])
        z = None if z is None else z.repeat_interleave(shape[1])
    columns = {f"{axis} (m)": at.tolist() for axis, at in (("x", x), ("z", z)) if at is not None}
    columns |= {f"{part} (rho c)": column for part, column in values.items()}
    rows = [dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True)]
    return Table(rows, [Column(name) for name in columns], ".6g")


def along_x(subject: MapSubject) -> list[Block]:
    """R and X along the liner, cells and references."""
    result, left_out = subject.thinned
    if result.mean_velocity.numel() < FEW:
        z = complex(subject.result.impedance.reshape(-1, len(result.frequency))[0, subject.main])
        return [Text(typeset(f"One probe, Z = {format_complex(z)}: there is nothing along x."))]
    blocks: list[Block] = []
    others = [name for name in result.averagings if name != result.averaging]
    open_ = "; ".join(f"{FACES[name]}, {name}" for name in others)
    for i in subject.drawn:
        curves = impedance_along_x(result, i)
        ends = {part: _percentiles(torch.from_numpy(curves.values[part]).double().flatten())
                for part in COMPLEX_PART}  # fmt: skip
        frequency = float(result.frequency[i])
        alt = f"Two curves along x at {frequency:g} Hz, {len(curves.at)} places: " + "; ".join(
            f"{part} from {low:.3f} to {high:.3f}, median {middle:.3f}"
            for part, (low, middle, high) in ends.items()
        ) + "."  # fmt: skip
        bands = interval_words(result)
        caption = (
            f"Impedance along x at {frequency:g} Hz, the admittance averaged over z. Cells: filled "
            f"markers, {result.averaging}{'; ' * bool(open_)}{open_}." + (f" Bands and bars: {bands}." if bands else "")
        )
        drawn = figures.draw_along_x([result], None, i)
        blocks.append(Figure(f"along-x-{i}", drawn, typeset(alt), caption, curves.table))
    return _with_words(blocks, subject, left_out)


def in_complex_plane(subject: MapSubject) -> list[Block]:
    """Where probes, cells and the whole liner lie, and what is known of it."""
    result, _ = subject.thinned
    blocks: list[Block] = []
    for i in subject.drawn:
        table = plane_table(subject.result, i)
        places = [f"{row['what']} {row['name']} {format_complex(row['impedance'])}"
                  for row in table.rows if row["what"] != "cell"]  # fmt: skip
        frequency = float(result.frequency[i])
        caption = (
            f"Z over ρc in the complex plane at {frequency:g} Hz: probes, cells, the whole liner "
            "in each averaging and what is known of it from elsewhere. Crosses: "
            "statistical intervals of R and of X."
        )
        alt = f"Impedances in the complex plane at {frequency:g} Hz: {'; '.join(places)}."
        drawn = draw_complex_plane(result, i)
        blocks.append(Figure(f"complex-plane-{i}", drawn, typeset(alt), caption, table))
    return blocks


def spectrum(subject: MapSubject) -> list[Block]:
    """R and X over frequency, where there are several."""
    result, _ = subject.thinned
    if len(result.frequency) < 2:
        return []
    curves = impedance_over_frequency(result)
    low, high = float(result.frequency.min()), float(result.frequency.max())
    ends = {part: _percentiles(torch.from_numpy(curves.values[part]).double())
            for part in COMPLEX_PART}  # fmt: skip
    alt = (
        f"Resistance and reactance of the whole liner at {len(curves.at)} frequencies from "
        f"{low:g} to {high:g} Hz: " + "; ".join(
            f"{part} {first:.3f} to {last:.3f}, median {middle:.3f}"
            for part, (first, middle, last) in ends.items()) + "."
    )  # fmt: skip
    others = [name for name in result.averagings if name != result.averaging]
    lines = "; ".join(f"{style}, {name}" for style, name in zip(("dashed", "dotted"), others, strict=False))
    bars = interval_words(result)
    caption = (
        f"Impedance of the whole liner over frequency: solid, {result.averaging}; {lines}. Shaded: "
        "middle half of the probes."
        + (f" Bars: {bars}." if bars else "")
        + " The axis leaves out poles of Z; the CSV does not."
    )
    drawn = figures.draw_spectrum([result])
    return [Figure("spectrum", drawn, typeset(alt), caption, curves.table)]


def _with_words(blocks: list[Block], subject: MapSubject, left_out: str) -> list[Block]:
    """What was thinned, and how many frequencies are drawn."""
    words = [left_out] * bool(left_out)
    count = len(subject.result.frequency)
    if len(subject.drawn) < count:
        here = float(subject.result.frequency[subject.main])
        words.append(
            f"Drawn at {here:g} Hz, one of {count} frequencies, at which the velocity is most in "
            "step with the tone; the spectrum shows all."
        )
    return [*map(Text, words), *blocks]
