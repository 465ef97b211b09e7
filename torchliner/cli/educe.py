"""torchliner educe."""

from __future__ import annotations

import argparse
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.options import (
    add_output_options,
    frequencies,
    liner_name,
    print_json,
    progress_bar,
    warnings_on_stderr,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    from torchliner.records import ImpedanceMap, VelocityPlane
    from torchliner.report.numbers import HeightRow

CHOICES = [
    "engine",
    "phase",
    "edge",
    "window",
    "drive",
    "mean",
    "kernel",
    "response",
    "levels",
    "spacing",
    "interpolation",
    "velocity_max",
    "pre_roll",
    "running_window",
    "minimum_coherence",
    "missing",
    "allow_short",
    "device",
    "dtype",
    "band",
    "memory",
    "compile",
    "rank_tolerance",
    "segment",
    "interval",
    "draws",
    "seed",
    "resample",
    "wall_filter",
]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options; their defaults are those of ``torchliner.educe``."""
    parser.add_argument("planes", nargs="+", type=Path, help="plane files (several: heights)")
    parser.add_argument("--liner", help="preset name, .toml or .csv; default: named in the file")
    parser.add_argument("--frequency", nargs="+", type=frequencies, metavar="HZ", help="values or "
                        "ranges LOW:HIGH:STEP; default: the tone, or the lines of --incident"
                        )  # fmt: skip
    parser.add_argument("-o", "--output", type=Path, help="map file, .h5/.nc or .csv; several "
                        "planes: their names are appended")  # fmt: skip
    parser.add_argument("--figures", type=Path, metavar="FOLDER", help="draw pictures there")
    parser.add_argument("--in-situ", type=Path, metavar="FILE", help="pressure record of the same "
                        "case: its in situ impedance stands in map, table and figures")  # fmt: skip
    parser.add_argument("--engine", choices=["auto", "spectral", "unfold", "direct"])
    parser.add_argument("--incident", metavar="SIGNAL", help="instead of tones: tones:500,900, "
                        "sweep:300:6000:logarithmic, noise:300:6000:SEED, or a .wav or .npy file"
                        )  # fmt: skip
    parser.add_argument("--incident-rate", type=float, metavar="HZ", help="of a .npy file")
    parser.add_argument("--segment", type=float, metavar="S", help="of --incident's estimate")
    parser.add_argument("--reflected", type=Path, metavar="FILE", help="write the reflected signal "
                        "of every probe (netCDF-4)")  # fmt: skip
    parser.add_argument("--phase", choices=["averaged", "self-consistent", "given"])
    parser.add_argument("--reference-phase", type=float, metavar="RAD", help="for --phase given: "
                        "x(t) = cos(2 pi f t + RAD)")  # fmt: skip
    parser.add_argument("--drive", choices=["instantaneous", "rms", "running-rms"])
    parser.add_argument("--mean", choices=["kept", "removed"], help="time-mean of v in the drive")
    parser.add_argument("--kernel", choices=["two-sided", "causal"])
    parser.add_argument("--response", choices=["model", "kernel"])
    parser.add_argument("--edge", choices=["auto", "finite", "wrap", "silent"])
    parser.add_argument("--window", help="window of scipy, e.g. hann, boxcar, kaiser,8")
    parser.add_argument("--band", nargs=2, type=float, metavar="HZ", help="band of the kernel")
    parser.add_argument("--levels", type=int, help="velocity levels of the tables")
    parser.add_argument("--spacing", choices=["sqrt", "uniform"])
    parser.add_argument("--interpolation", choices=["cubic", "linear"])
    parser.add_argument("--velocity-max", type=float, metavar="M/S", help="top of the levels")
    parser.add_argument("--pre-roll", type=float, metavar="S", help="start that only emits")
    parser.add_argument("--running-window", type=float, metavar="S", help="of --drive running-rms")
    parser.add_argument("--minimum-coherence", type=float, help="for --phase self-consistent")
    parser.add_argument("--wall-filter", type=float, metavar="C", help="squared coherence with the "
                        "tone below which a probe counts as wall in averages")  # fmt: skip
    parser.add_argument("--missing", choices=["refuse", "exclude"], help="probes with nan or inf")
    parser.add_argument("--allow-short", action="store_true", default=None,
                        help="accept fewer than four periods")  # fmt: skip
    parser.add_argument("--interval", type=float, metavar="LEVEL", help="of the error bars, 0 to "
                        "1; default 0.95")  # fmt: skip
    parser.add_argument("--no-intervals", action="store_true", help="no error bars")
    parser.add_argument("--draws", type=int, help="of the moving-block bootstrap; default 999")
    parser.add_argument("--seed", type=int, help="of the bootstrap; default 0")
    parser.add_argument("--resample", choices=["time", "time-span", "time-cells"],
                        help="what is resampled for the whole liner")  # fmt: skip
    parser.add_argument("--device", help="cpu, cuda, cuda:1")
    parser.add_argument("--dtype", choices=["float32", "float64"])
    parser.add_argument("--memory", metavar="SIZE", help="for slabs and work, e.g. 500MB, 2GB")
    parser.add_argument("--compile", choices=["auto", "never", "always"], help="fuse inner loops")
    parser.add_argument("--rank-tolerance", type=float, metavar="R", help="error in R allowed to "
                        "the low-rank kernels of --engine unfold")  # fmt: skip
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Educe every plane, print one row each, write what was asked for."""
    from torchliner.cli.insitu import with_in_situ
    from torchliner.eduction.velocity import educe
    from torchliner.io.plane_file import read_plane
    from torchliner.liners.catalogue import load_liner

    chosen = {key: getattr(options, key) for key in CHOICES if getattr(options, key) is not None}
    if options.no_intervals:
        chosen["interval"] = None
    if "band" in chosen:
        chosen["band"] = tuple(chosen["band"])
    outputs = _outputs(options.output, options.planes)
    _check_targets(options, outputs)
    incident = _incident(options)
    if incident is not None:
        chosen["incident"] = incident
    wanted = None if options.frequency is None else list(chain(*options.frequency))
    liner = load_liner(options.liner) if options.liner else None
    planes: list[VelocityPlane] = []
    with warnings_on_stderr(options.quiet):
        members_of: dict[str, list[int]] = {}
        for i, path in enumerate(options.planes):
            planes.append(read_plane(path, lazy=True))
            name = "" if liner else liner_name(planes[-1], path)
            members_of.setdefault(name, []).append(i)
        results: dict[int, ImpedanceMap] = {}
        for name, members in members_of.items():
            # Planes of one liner share levels and kernels.
            total = sum(2 * planes[i].samples for i in members)
            label = options.planes[members[0]].name
            with progress_bar(total, label, options.quiet) as step:
                several = educe(
                    [planes[i] for i in members], liner or load_liner(name), wanted, progress=step,
                    reference_phase=options.reference_phase, reflected=options.reflected, **chosen,
                )  # fmt: skip
            results |= dict(zip(members, several, strict=True))
        found = [results[i] for i in range(len(planes))]
        if options.in_situ is not None:
            found = with_in_situ(found, planes, options.in_situ)
        for path, result in zip(options.planes, found, strict=True):
            if path in outputs:
                result.write(outputs[path])
        if options.figures is not None:
            _draw(found, planes, options.figures)
    _print(found, options)
    return 0


def _check_targets(options: argparse.Namespace, outputs: dict[Path, Path]) -> None:
    """No output may be an input, or another output."""
    if options.reflected is not None and len(options.planes) > 1:
        raise ValueError("several planes would share one reflected file; educe them one by one")
    inputs = {path.resolve(): "a plane" for path in options.planes}
    for name in ("liner", "incident", "in_situ"):
        if getattr(options, name) is not None:
            said = f"what --{name.replace('_', '-')} reads"
            inputs[Path(getattr(options, name)).resolve()] = said
    for path in (*outputs.values(), *([options.reflected] if options.reflected else [])):
        if path.resolve() in inputs:
            raise ValueError(f"the output {path} is {inputs[path.resolve()]}; name another file")
        inputs[path.resolve()] = "another output"


def _incident(options: argparse.Namespace) -> Any:
    """The incident signal, or None."""
    from torchliner.io.signal_file import read_signal
    from torchliner.replay.waves import parse_signal

    if options.incident is None:
        if options.incident_rate is not None:
            raise ValueError("--incident-rate is the rate of an --incident file; name the file")
        return None
    generated = parse_signal(options.incident)
    if generated is None:
        return read_signal(options.incident, options.incident_rate)
    if options.incident_rate is not None:
        raise ValueError(
            "--incident-rate is for a file; a generated signal has the rate of the plane"
        )
    return generated


def _outputs(output: Path | None, planes: list[Path]) -> dict[Path, Path]:
    """Map file of each plane; refuses to overwrite an input or one map with another."""
    if output is None:
        return {}
    named = {
        plane: output if len(planes) == 1 else output.with_stem(f"{output.stem}_{plane.stem}")
        for plane in planes
    }
    inputs = {plane.resolve() for plane in planes}
    for target in named.values():
        if target.resolve() in inputs:
            raise ValueError(f"the output {target} is one of the planes; name another file")
    if len(set(named.values())) < len(planes):
        raise ValueError("planes of the same name would share one map file; educe them one by one")
    return named


def _draw(results: list[ImpedanceMap], planes: list[VelocityPlane], folder: Path) -> None:
    """Pictures of all planes; those of other frequencies than the first go to folders of theirs."""
    groups: dict[tuple[float, ...], list[int]] = {}
    for i, result in enumerate(results):
        groups.setdefault(tuple(result.frequency.tolist()), []).append(i)
    for number, members in enumerate(groups.values()):
        where = folder if number == 0 else folder / _stem(planes[members[0]])
        _draw_group([results[i] for i in members], [planes[i] for i in members], where)


def _stem(plane: VelocityPlane) -> str:
    return Path(plane.name.split(":/")[0]).stem


def _draw_group(results: list[ImpedanceMap], planes: list[VelocityPlane], folder: Path) -> None:
    from torchliner.report import figures
    from torchliner.report.numbers import impedance_along_x, velocity_along_x
    from torchliner.report.spectra import draw_spectrum, impedance_over_frequency

    folder.mkdir(parents=True, exist_ok=True)
    frequencies = results[0].frequency.tolist()
    for i, frequency in enumerate(frequencies):
        end = "" if len(frequencies) == 1 else f"_{frequency:g}Hz"
        for result, plane in zip(results, planes, strict=True):
            stem = _stem(plane)
            if result.mean_velocity.ndim == 2:
                figures.draw_map(result, folder / f"map_{stem}{end}.png", i)
            impedance_along_x(result, i).write_csv(folder / f"along_x_{stem}{end}.csv")
        figures.draw_along_x(results, folder / f"along_x{end}.png", i)
        if len(results) > 1:
            figures.draw_against_height(results, folder / f"height{end}.png", i)
    if len(frequencies) > 1:
        draw_spectrum(results, folder / "spectrum.png")
        for result, plane in zip(results, planes, strict=True):
            stem = _stem(plane)
            impedance_over_frequency(result).write_csv(folder / f"spectrum_{stem}.csv")
    for plane in planes:
        stem = _stem(plane)
        velocity_along_x(plane).write_csv(folder / f"velocity_{stem}.csv")
    figures.draw_velocity(planes, folder / "velocity.png")


def _print(results: list[ImpedanceMap], options: argparse.Namespace) -> None:
    from torchliner.report.alongside import alongside_surfaces
    from torchliner.report.numbers import against_height
    from torchliner.report.truth import format_complex

    if options.json:
        print_json([_summary(result) for result in results])
        return
    print(f"{'y mm':>6s} {'f Hz':>7s} {'Z, admittance over probes':>26s} {'spread R, X':>14s} "
          f"{'Z, velocity first':>18s} {'coherence':>9s} {'incident dB':>11s}")  # fmt: skip
    rows = against_height(results)
    for row in rows:
        height = "-" if row.height is None else f"{1e3 * row.height:.2f}"
        spread = f"{row.spread.real:.3f} {row.spread.imag:.3f}"
        print(f"{height:>6s} {row.frequency:7.1f} {format_complex(row.probes_first):>26s} "
              f"{spread:>14s} {format_complex(row.velocity_first):>18s} {row.coherence:9.2f} "
              f"{row.level:11.1f}")  # fmt: skip
    _print_intervals(rows, results)
    seen: dict[str, None] = {}
    for i, f in enumerate(results[0].frequency.tolist()):
        beside = alongside_surfaces(results, i)
        seen |= {f"{f:g} Hz, {n}: {format_complex(v)}": None for n, v in beside.items()}
    for result in results:
        case = result.title.split(", y =")[0]
        seen |= {f"{case}, {n}: {format_complex(v)}": None for n, v in result.reference.items()}
        if result.choices.get("surface") == "hard wall":
            seen[f"{case}: NULL TEST, there is a hard wall below these data and no liner; the "
                 "values only show what this model makes of such a velocity"] = None  # fmt: skip
    print("\n".join(seen) + "\n" * bool(seen), end="")
    choices = results[0].choices
    made = ", ".join(
        f"{key} {choices[key]}" for key in ("engine", "phase", "edge", "drive", "kernel")
    )
    error = choices.get("kernel_error")
    print(f"Z is p/(rho c v), exp(+jwt); {made}"
          + (f"; kernel error in R {error:.1e}" if error is not None else ""))  # fmt: skip


def _print_intervals(rows: Sequence[HeightRow], results: Sequence[ImpedanceMap]) -> None:
    """Statistical intervals, apart from the spread over positions."""
    found = results[0].uncertainty
    if found is None:
        return
    print(f"\n{100 * found.settings['level']:g} % statistical interval (the spread above is that "
          "over probes, no uncertainty)")  # fmt: skip
    print(f"{'y mm':>6s} {'f Hz':>7s} {'R, over probes':>19s} {'X, over probes':>19s} "
          f"{'R, velocity first':>19s} {'X, velocity first':>19s}")  # fmt: skip
    for row in rows:
        height = "-" if row.height is None else f"{1e3 * row.height:.2f}"
        cells = []
        for bounds in (row.interval, row.interval_velocity_first):
            for part in ("real", "imag"):
                ends = [getattr(end, part) for end in bounds or ()]
                cells.append(" to ".join(f"{end:.3f}" for end in ends) or "-")
        print(f"{height:>6s} {row.frequency:7.1f} " + " ".join(f"{cell:>19s}" for cell in cells))
    print()


def _summary(result: ImpedanceMap) -> dict[str, Any]:
    from torchliner.report.alongside import alongside_surfaces
    from torchliner.report.numbers import against_height

    frequencies = result.frequency.tolist()
    return {
        "title": result.title,
        "rows": [vars(row) for row in against_height([result])],
        "reference": dict(result.reference),
        "alongside": [
            {"frequency": f, "impedance": alongside_surfaces([result], i)}
            for i, f in enumerate(frequencies)
            if result.alongside
        ],
        "choices": dict(result.choices),
        "notes": list(result.notes),
    }
