"""torchliner duct."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torchliner as tl
from torchliner import names
from torchliner.cli import options as opt
from torchliner.cli.files import show_results, write_copy
from torchliner.file_names import frequency_ends

if TYPE_CHECKING:
    from torchliner.duct.mesh import DuctMesh
    from torchliner.duct.presets import DuctSetup


def wall(text: str) -> str | complex:
    """A hard wall, or its impedance."""
    return text if text == "rigid" else opt.finite(text)


FLOW = [
    opt.frequency("the duct's"),
    opt.Option("--bulk-mach", "Mach number of the flow; default: the duct's", opt.NUMBER),
    opt.Option("--profile", "of the flow; default: the duct's", names.FLOW_PROFILES),
    opt.Option("--shear", "of --profile tanh, half heights; default: the duct's", opt.NUMBER),
    opt.Option("--allow-thin", "take a shear below 0.03 too, to study it"),
    opt.Option(
        "--impedance",
        "R+Xj or rigid, one a lined patch; default: the duct's",
        opt.Kind("Z", "'rigid' or a value as 2.3-0.3j", wall),
        nargs="+",
    ),
]
SOUND = [
    opt.Option("--level", "of the incident wave, dB re 20 uPa rms; default: the duct's", opt.DB),
    opt.Option("--source-side", "side that the sound comes from; default: the duct's", names.SOURCES),
    opt.Option("--end-reflection", "of the far end, complex; default: the duct's", opt.COMPLEX),
]
DUCT = [
    opt.Option("duct", "preset or .toml file; without: list the presets", opt.DUCT, nargs="?"),
    *FLOW,
    opt.Option("--liner", "preset, .toml, .csv or .py file: Z(f) of a liner; default: --impedance", opt.LINER),
    opt.Option("--speed", "|v| at the liner, rms, with --liner; default 0", opt.MPS),
    *opt.PRINTING,
]
SOLVE = [
    *SOUND,
    opt.Option(
        "--mesh",
        "largest cell, and cell at the walls, mm: solve on that mesh alone; default: a finer mesh checks the answer, "
        "to 0.05 dB",
        opt.MM,
        nargs="+",
    ),
    opt.output("write the microphones, for torchliner kt, and but for .csv report,", ".csv", *opt.HDF5),
    *opt.figure("draw SPL and phase along the wall there, a picture a frequency"),
    opt.Option("--field", "draw |p| and |v| in the duct there, a picture a frequency", opt.PICTURE),
    opt.COPY,
]
MODES = [
    opt.Option("--count", "modes in each direction; default 4", opt.COUNT, default=4),
    opt.output("write the wavenumbers", ".csv"),
    *opt.figure("draw the modes' pressure over the height there, a picture a frequency"),
]
TASKS = {
    "solve": (
        "sound field of a lined duct with flow",
        "Linearised Euler equations in two dimensions; SPL and phase at microphones.",
        [*DUCT, *SOLVE],
        ("b2a --frequency 1000:2000:500 --figure field.png -o b2a.h5",),
    ),
    "modes": (
        "wavenumbers of the lined duct",
        "Pridmore-Brown modes above an infinite liner, both directions.",
        [*DUCT, *MODES],
        ("b2a --frequency 1400",),
    ),
}


def run(options: argparse.Namespace) -> int:
    """The task named after ``duct``."""
    from torchliner.duct.presets import duct_names, duct_text

    solve = options.task == "solve"
    copy = options.copy if solve else None
    if copy is None and options.duct is not None:
        return (_solve if solve else _modes)(options, _setup(options))
    changed = {*opt.given(options, [*DUCT[1:], *(SOLVE if solve else MODES)])} - {"copy", "json", "quiet", "count"}
    if changed:
        what = "--copy writes the preset as it stands" if copy is not None else "the list of presets has no options"
        raise ValueError(f"{what}: leave {opt.spelled(sorted(changed))} out, or name a duct to solve")
    if copy is not None:
        write_copy(duct_text(options.duct or ""), copy)
    print(f"{copy}: preset {options.duct}" if copy is not None else "presets: " + ", ".join(duct_names()))
    return 0


def _setup(options: argparse.Namespace) -> DuctSetup:
    setup = tl.load_duct(options.duct, **opt.given(options, FLOW + (SOUND if options.task == "solve" else [])))
    if options.liner is not None:
        if options.impedance is not None:
            raise ValueError("--impedance and --liner both state the wall; keep one")
        return _with_liner(setup, options.liner, options.speed or 0.0)
    if options.speed is not None:
        raise ValueError("--speed is |v| at the liner that --liner names; name one")
    return setup


def _with_liner(setup: DuctSetup, name: str, speed: float) -> DuctSetup:
    """All patches lined alike, by Z(f) of a liner at |v| = speed, m/s."""
    from torchliner.checks import tell
    from torchliner.fluid import gas_warnings

    liner = tl.load_liner(name).in_flow(setup.case.profile.bulk_mach)
    if liner.fluid is not None:
        tell(gas_warnings(liner.fluid, setup.fluid, f"duct {setup.name}"))
    walls = liner.impedance(setup.frequency, speed)[:, None].expand(-1, len(setup.case.liner))
    sound = {**setup.facts["sound"], "impedance": None, "impedance_file": None, "liner": name, "speed": speed}
    return replace(setup, impedance=walls, facts={**setup.facts, "sound": sound})


def _solve(options: argparse.Namespace, setup: DuctSetup) -> int:
    from torchliner.records.origin import origin_of
    from torchliner.report.duct_report import draw_field, draw_walls, format_duct, plain_duct

    about: dict[str, Any] = {"places": setup.places, "wall": setup.wall, "mesh": _mesh(options.mesh, setup)}
    field = tl.solve_settled(setup.case, setup.frequency, setup.impedance, **about)
    found = plain_duct(setup, field)
    tables = (setup.facts["flow"]["file"], setup.facts["sound"]["impedance_file"])
    beside = [("table", Path(options.duct).parent / name) for name in tables if name is not None]
    origin = origin_of([("duct", options.duct), ("liner", options.liner or ""), *beside], command=options.typed)
    if options.field is not None:
        for f, path in enumerate(_a_frequency(options.field, setup)):
            draw_field(setup, field, path, f)

    def draw(picture: Path) -> None:
        for f, path in enumerate(_a_frequency(picture, setup)):
            draw_walls([(setup, field)], path, f)

    def write(path: Path) -> None:
        setup.line_of(field, **origin).write(path)

    show_results(options, format_duct(setup, found), found, output=write, figure=draw)
    return 0


def _mesh(sizes: list[float] | None, setup: DuctSetup) -> DuctMesh | None:
    """Of the largest cell and the one at the walls, in mm."""
    from torchliner.duct.mesh import build_mesh

    if sizes is None:
        return None
    if len(sizes) > 2:
        raise ValueError(f"--mesh has {len(sizes)} sizes; write the largest cell and the wall's")
    cell, *at_wall = [1e-3 * size for size in sizes]
    highest = float(setup.frequency.max())
    return build_mesh(setup.case, highest, column=cell, row=cell, wall_cell=at_wall[0] if at_wall else None)


def _a_frequency(path: Path, setup: DuctSetup) -> list[Path]:
    """The picture of each frequency: the path itself for one, else NAME_1500Hz.png."""
    return [path.with_stem(path.stem + end) for end in frequency_ends(setup.frequency.tolist())]


def _modes(options: argparse.Namespace, setup: DuctSetup) -> int:
    from torchliner.report.duct_report import draw_modes, format_modes, mode_table

    profile, f, about = setup.case.profile, setup.frequency, setup.case.slip_condition
    modes = {
        direction: tl.duct_modes(
            profile, f, setup.first_wall, direction=direction, count=options.count, slip_condition=about
        )
        for direction in names.DIRECTIONS
    }
    table = mode_table(setup, modes, tl.growing_wave(profile, f, setup.first_wall, about))

    def draw(picture: Path) -> None:
        for i, path in enumerate(_a_frequency(picture, setup)):
            draw_modes(modes, path, i)

    plain = {"duct": setup.facts, "modes": table.as_rows()}
    show_results(options, format_modes(setup, table), plain, output=table.write_csv, figure=draw)
    return 0
