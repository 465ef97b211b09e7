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
    from torchliner.records import ImpedanceMap, VelocityPlane

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
    from torchliner.report.summary import format_maps, plain_map

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
            from torchliner.report.pictures import draw_pictures

            draw_pictures(found, planes, options.figures)
    if options.json:
        print_json([plain_map(result) for result in found])
    else:
        print(format_maps(found))
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
