"""torchliner height."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.choice_options import NO_GIVEN_PHASE, choice_options, chosen_from
from torchliner.cli.files import check_files, only_liner, read_planes
from torchliner.cli.options import print_json, progress_bar, shared

if TYPE_CHECKING:
    from torchliner.heights.recommend import Recommendation
    from torchliner.heights.study import HeightStudy

CHOICES = ("phase", "drive", "mean", "edge", "missing", "allow_short", "wall_filter", "memory")

OPTIONS = {
    "": {
        "planes PLANE ...": "plane files of one case, one a height",
        "--frequency HZ": "default: the tone of the files",
        "--lengths MM ...": "averaging, mm; default: a spacing, shares of a cell, cells, all",
        "--cell-pitch MM": "mm; default: the liner's",
        "--duct-height MM": {"default": 50.0, "help": "of the jets' cross-flow, mm; default 50"},
        "--shear D": {"default": 0.05, "help": "of its tanh profile, half heights; default 0.05"},
        "--limits IMPRINT ORDERS CHANGE": "that a height keeps to, relative; default 0.1 0.1 0.1",
    }
    | shared("--liner", "--output", "--figures", "--json", "--quiet"),
} | choice_options(CHOICES, NO_GIVEN_PHASE)  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Study the heights, print rows, facts and the recommendation."""
    from torchliner.heights.facts import JetFlow
    from torchliner.heights.recommend import Limits, recommend_height
    from torchliner.heights.study import study_heights
    from torchliner.report.height import write_rows

    check_files(options, [*options.planes, options.liner], ".csv")
    limits = Limits(*options.limits) if options.limits else Limits()
    flow = JetFlow(1e-3 * options.duct_height, options.shear)
    planes = read_planes(options.planes)
    liner = only_liner(options.liner, planes, options.planes)
    lengths = None if options.lengths is None else [1e-3 * value for value in options.lengths]
    pitch = None if options.cell_pitch is None else 1e-3 * options.cell_pitch
    with progress_bar(len(lengths or []) or 8, "averaging lengths", options) as step:
        study = study_heights(
            planes, liner, options.frequency, lengths=lengths, cell_pitch=pitch, flow=flow,
            progress=step, **chosen_from(options, CHOICES),
        )  # fmt: skip
    found = recommend_height(study, limits)
    if options.output is not None:
        write_rows(study, options.output)
    if options.figures is not None:
        _draw(study, options.figures)
    if options.json:
        print_json(_plain(study, found))
    else:
        _print(study, found)
    return 0


def _draw(study: HeightStudy, folder: Path) -> None:
    from torchliner.report import height

    folder.mkdir(parents=True, exist_ok=True)
    height.draw_impedance_over_height(study, folder / "impedance_over_height.png")
    height.impedance_over_height(study).write_csv(folder / "impedance_over_height.csv")
    imprint = height.imprint_over_height(study)
    if imprint.values:
        height.draw_imprint(study, folder / "imprint_over_height.png")
        imprint.write_csv(folder / "imprint_over_height.csv")


def _plain(study: HeightStudy, found: Recommendation) -> dict[str, Any]:
    from torchliner.report.height import imprint_over_height, plain_rows

    imprint = imprint_over_height(study)
    return {
        "title": study.title,
        "frequency": study.frequency,
        "cell_pitch": study.pitch,
        "rows": plain_rows(study),
        "imprint": {"height (m)": imprint.at.tolist()}
        | {name: values.tolist() for name, values in imprint.values.items()},
        "decay_length": None if study.decay is None else study.decay.length,
        "first_harmonic_decay_length": None
        if study.first_decay is None
        else study.first_decay.length,
        "evanescent_length": None if study.decay is None else study.decay.evanescent,
        "recommended_height": found.height,
        "judgements": [vars(one) | {"passed": one.passed} for one in found.judgements],
        "reasons": list(found.reasons),
        "unknown": list(found.unknown),
        "reference": study.reference,
        "choices": study.choices,
        "notes": list(study.notes),
    }


def _print(study: HeightStudy, found: Recommendation) -> None:
    from torchliner.report.height import length_label
    from torchliner.report.table import format_complex

    print(f"{study.title}, {study.frequency:g} Hz; Z is p/(rho c v), exp(+jwt); spread: standard "
          "deviation of R and X over windows")  # fmt: skip
    orders = (
        f"{'admittance over probes':>22s} {'spread':>13s} {'velocity first':>15s} {'spread':>13s}"
    )
    print(f"{'y mm':>6s} {'length':>9s} {'probes':>6s} {'windows':>7s} {orders}")
    for row in study.rows:
        spread = [_spread(row.probes_first_spread), _spread(row.velocity_first_spread)]
        label = length_label(row.length, study.pitch)
        print(f"{1e3 * row.height:6.2f} {label:>9s} {row.probes:6d} {row.windows:7d} "
              f"{format_complex(row.probes_first):>22s} {spread[0]:>13s} "
              f"{format_complex(row.velocity_first):>15s} {spread[1]:>13s}")  # fmt: skip
    print(f"\n{'y mm':>6s} {'coherence':>9s} {'v_rms m/s':>10s} {'imprint v_rms':>13s} "
          f"{'between':>8s} {'imprint u_rms':>13s} {'U_j m/s':>8s} {'H_j mm':>7s}")  # fmt: skip
    for one in study.facts:
        imprint, stream = one.imprint, one.streamwise_imprint
        between = None if imprint is None or imprint.between is None else (
            imprint.between / imprint.mean)  # fmt: skip
        print(f"{1e3 * one.height:6.2f} {one.coherence:9.2f} {one.velocity_rms:10.3f} "
              f"{_number(imprint.relative if imprint else None, 13, 4)} {_number(between, 8, 4)} "
              f"{_number(stream.relative if stream else None, 13, 4)} "
              f"{_number(one.jet_velocity, 8, 1)} "
              f"{_number(one.jet_height and 1e3 * one.jet_height, 7, 2)}")  # fmt: skip
    if study.first_decay is not None:
        first = study.first_decay
        print(f"first harmonic of v_rms: exp(-y/l), l = {1e3 * first.length:.3g} mm (sound: "
              f"{1e3 * first.evanescent:.3g} mm); heights stray from it by a factor "
              f"{first.scatter:.3g}")  # fmt: skip
    print("\n" + "\n".join(found.reasons))
    for line in found.unknown:
        print(f"not judged: {line}")
    for name, value in study.reference.items():
        print(f"not used above: {name} {format_complex(value)}")


def _spread(value: complex) -> str:
    return "-" if value != value else f"{value.real:.3f} {value.imag:.3f}"


def _number(value: float | None, width: int, digits: int) -> str:
    return f"{'-':>{width}s}" if value is None else f"{value:{width}.{digits}f}"
