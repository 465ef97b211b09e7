"""torchliner educe."""

from __future__ import annotations

import argparse
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.choice_options import CHOICES, add_choice_options, chosen_from
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
    parser.add_argument("--incident", metavar="SIGNAL", help="instead of tones: tones:500,900, "
                        "sweep:300:6000:logarithmic, noise:300:6000:SEED, or a .wav or .npy file"
                        )  # fmt: skip
    parser.add_argument("--incident-rate", type=float, metavar="HZ", help="of a .npy file")
    parser.add_argument("--reflected", type=Path, metavar="FILE", help="write the reflected signal "
                        "of every probe (netCDF-4)")  # fmt: skip
    parser.add_argument("--reference-phase", type=float, metavar="RAD", help="for --phase given: "
                        "x(t) = cos(2 pi f t + RAD)")  # fmt: skip
    parser.add_argument("--no-intervals", action="store_true", help="no error bars")
    add_choice_options(parser, list(CHOICES))
    add_output_options(parser)


def run(options: argparse.Namespace) -> int:
    """Educe every plane, print one row each, write what was asked for."""
    from torchliner.cli.insitu import with_in_situ
    from torchliner.io.plane_file import read_plane
    from torchliner.liners.catalogue import load_liner
    from torchliner.report.map_table import format_maps, plain_map
    from torchliner.tdibc.educe import educe

    chosen = chosen_from(options)
    if options.no_intervals:
        chosen["interval"] = None
    if options.in_situ is not None and not options.in_situ.exists():
        raise FileNotFoundError(f"{options.in_situ}: no such file")
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
