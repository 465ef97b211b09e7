"""Height studies as curves and drawings: Z and cell-periodic modulation over height."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from torchliner.report.figure import (
    COLOURS,
    MARKERS,
    REFERENCES,
    U_RMS,
    V_RMS,
    Figure,
    finish,
    impedance_panels,
    label_axes,
    styled,
    subplots,
)
from torchliner.report.numbers import COMPLEX_PART, Array, Curves, part_of
from torchliner.studies.rows import Study

AVERAGINGS = {"admittance": "admittance over probes", "velocity": "velocity averaged"}
MOST_LENGTHS = 5  # curves a reader can tell apart


def length_label(length: float, pitch: float | None) -> str:
    """'1/4 cell', '2 cells' or millimetres."""
    if pitch is not None:
        for share, name in ((1 / 8, "1/8 cell"), (1 / 4, "1/4 cell"), (1 / 2, "1/2 cell")):
            if abs(length / pitch - share) < 0.02 * share:
                return name
        cells = round(length / pitch)
        if cells and abs(length / pitch - cells) < 0.01 * cells:
            return "1 cell" if cells == 1 else f"{cells} cells"
    return f"{1e3 * length:.3g} mm"


def impedance_over_height(study: Study) -> Curves:
    """R and X over height, one column per averaging length, averaging and part."""
    values: dict[str, Array] = {}
    for length in study.lengths:
        rows = study.of(length=length)
        for part in COMPLEX_PART:
            for averaging in AVERAGINGS:
                name = f"{part}, {averaging}, {1e3 * length:.4g} mm"
                values[name] = np.array([part_of(row[averaging], part) for row in rows])
    heights = np.array([facts.height for facts in study.facts])
    return Curves(heights, values, study.title, "height (m)")


def imprint_over_height(study: Study) -> Curves:
    """Cell-periodic parts, rms, relative to the mean of the profile (of v_0: to that of v'); nan: unknown."""
    known = [facts.modulation for facts in study.facts]
    steady = [facts.mean_modulation for facts in study.facts]
    stream = [facts.streamwise_modulation for facts in study.facts]
    columns = {
        "v' rms": [i and i.relative for i in known],
        "v' rms, first harmonic": [i and i.first / 2**0.5 / i.mean for i in known],
        "v' rms, between harmonics": [i and i.between and i.between / i.mean for i in known],
        "v0": [s and i and s.rms / i.mean for s, i in zip(steady, known, strict=True)],
        "u' rms": [u and u.relative for u in stream],
    }
    values = {name: np.array(numbers, dtype=np.float64) for name, numbers in columns.items()
              if any(number is not None for number in numbers)}  # fmt: skip
    heights = np.array([facts.height for facts in study.facts])
    if study.decay is not None:
        values["v' rms, fitted decay"] = study.decay.at(heights)
    return Curves(heights, values, study.title, "height (m)")


@styled
def draw_impedance_over_height(study: Study, path: str | Path | None = None) -> Figure:
    """R and X over height: admittance over probes, and velocity averaged over several lengths."""
    figure, panels = impedance_panels(3.2, "$y$ (mm)")
    lengths = tuple(
        length for length in study.lengths[1:]
        if any(row.velocity == row.velocity for row in study.of(length=length))
    )  # fmt: skip
    if len(lengths) > MOST_LENGTHS:
        keep = np.unique(np.linspace(0, len(lengths) - 1, MOST_LENGTHS).round().astype(int))
        lengths = tuple(lengths[i] for i in keep)
    for axis, part in panels:
        rows = study.of(length=study.lengths[0])
        heights = [1e3 * row.height for row in rows]
        values = [part_of(row.admittance, part) for row in rows]
        axis.plot(heights, values, "k*-", label="admittance over probes", markersize=6, zorder=4)
        for i, length in enumerate(lengths):
            rows = study.of(length=length)
            values = [part_of(row.velocity, part) for row in rows]
            spread = [part_of(row.velocity_spread, part) for row in rows]
            shifted = [h + 0.02 * (i - len(lengths) / 2) for h in heights]
            axis.errorbar(
                shifted, values, spread, marker=MARKERS[i], color=COLOURS[i], capsize=2,
                markerfacecolor="white", elinewidth=0.7,
                label=f"velocity over {length_label(length, study.pitch)}",
            )  # fmt: skip
        if "true" in study.reference:
            true = part_of(study.reference["true"], part)
            axis.axhline(true, label="reference", **REFERENCES[0])
    hard = " (null test)" if study.choices.get("surface") == "hard wall" else ""
    title = f"{study.title}{hard}, {study.frequency:g} Hz; bars: standard deviation over windows"
    return finish(figure, path, title, legend=3)


@styled
def draw_imprint(study: Study, path: str | Path | None = None) -> Figure:
    """Cell-periodic modulation over height, its fitted decay and that of an evanescent sound field."""
    curves = imprint_over_height(study)
    figure, axes = subplots(1, 1, 3.4)
    axis = axes[0, 0]
    names = {
        "v' rms": rf"{V_RMS}, all harmonics", "v' rms, first harmonic": rf"{V_RMS}, first harmonic",
        "v' rms, between harmonics": rf"{V_RMS}, between harmonics", "v0": "$v_0$", "u' rms": U_RMS,
    }  # fmt: skip
    for i, name in enumerate(name for name in curves.values if name in names):
        decay = study.decay if name == "v' rms" else None
        fitted = decay is not None and decay.follows
        axis.plot(
            1e3 * curves.at, curves.values[name], MARKERS[i] + ("" if fitted else ":"),
            color=COLOURS[i], label=names[name],
        )  # fmt: skip
        if decay is not None and fitted:
            text = rf"fit: $e^{{-y/l}}$, $l={1e3 * decay.length:.3g}$ mm"
            axis.plot(1e3 * curves.at, decay.at(curves.at), "-", color=COLOURS[i], label=text)
    if study.decay is not None:
        first = curves.values["v' rms, first harmonic"][0]
        sound = first * np.exp(-(curves.at - curves.at[0]) / study.decay.evanescent)
        text = rf"sound: $l=L_c/2\pi={1e3 * study.decay.evanescent:.3g}$ mm"
        axis.plot(1e3 * curves.at, sound, "--", color="0.3", label=text)
    axis.set_yscale("log")
    label_axes(axis, "$y$ (mm)", "cell-periodic part (rms) over mean")
    return finish(figure, path, f"{study.title}, {study.frequency:g} Hz", legend=2)
