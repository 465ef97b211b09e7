"""Commands that model a liner or a duct: liner, duct, ir-tdibc, export."""

from __future__ import annotations

import argparse
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import torchliner as tl
from torchliner import names
from torchliner.cli import kinds
from torchliner.cli import options as opt
from torchliner.cli.inputs import incident_signal, write_copy
from torchliner.cli.kinds import Command, Option
from torchliner.cli.output import facts_text, progress_bar, show

if TYPE_CHECKING:
    from torchliner.duct.presets import DuctSetup

FREQUENCIES = [500.0, 1000.0, 1400.0, 1500.0, 2000.0, 3000.0]
SPEEDS = [0.0, 1.0, 3.0, 5.0]


def liner(options: argparse.Namespace) -> None:
    """Print geometry, resonance, table; draw."""
    from torchliner.liners.catalogue import preset_text
    from torchliner.report.curves import draw_liner
    from torchliner.report.numbers import impedance_over_band

    if not options.liners:
        opt.require_alone(options, "name a liner")
        show(options, [*tl.preset_names()], _presets)
        return
    if options.copy is not None and len(options.liners) != 1:
        raise ValueError("--copy writes one preset; name one")
    liners = {name: tl.load_liner(name) for name in options.liners}
    if options.copy is not None:
        write_copy(preset_text(options.liners[0]), options.copy)
    speeds = options.speed or SPEEDS
    found: list[dict[str, Any]] = []
    for each in liners.values():
        low, high = each.frequency_range or (0.0, float("inf"))
        table = [
            {"frequency": f, "speed": v, "impedance": complex(each.impedance(f, v))}
            for f in options.frequency or FREQUENCIES
            if low <= f <= high
            for v in speeds
        ]
        found.append({"liner": _facts(each), "table": table})

    def draw(_: Any, path: Path) -> None:
        one = len(liners) == 1
        curves = [
            impedance_over_band(each, speed, f"$|v|$ = {speed:g} m s$^{{-1}}$" if one else Path(name).stem)
            for name, each in liners.items()
            for speed in (speeds if one else [0.0])
        ]
        draw_liner(curves, f"liner model {Path(next(iter(liners))).stem}" if one else "linear impedance", path)

    show(
        options,
        found if len(found) > 1 else found[0],
        lambda _: "\n\n".join(_text(one, speeds) for one in found),
        draw=draw,
    )


def _presets(names: list[str]) -> str:
    return f"presets: {', '.join(names)}"


def _facts(each: Any) -> dict[str, Any]:
    """All it states, and the resonance where it has one."""
    facts: dict[str, Any] = each.describe()
    if hasattr(each, "resonance"):
        facts["resonance_hz"] = None
        with suppress(ValueError):
            facts["resonance_hz"] = each.resonance()
    return facts


def _text(found: dict[str, Any], speeds: list[float]) -> str:
    """The facts, and Z, a row a frequency."""
    from torchliner.report.table import format_complex

    lines = ["SI units", facts_text(found["liner"]), "\nZ, normalised by rho c, at |v| in m/s"]
    lines.append(f"{'f Hz':>8s}" + "".join(f"{f'|v| = {v:g}':>18s}" for v in speeds))
    for first in range(0, len(found["table"]), len(speeds)):
        row = found["table"][first : first + len(speeds)]
        lines.append(f"{row[0]['frequency']:8.1f}" + "".join(f"{format_complex(c['impedance']):>18s}" for c in row))
    return "\n".join(lines)


def solve(options: argparse.Namespace) -> None:
    """Sound field of a lined duct with flow.

    Linearised Euler equations in two dimensions; SPL and phase at microphones.
    """
    from torchliner.duct.mesh import build_mesh
    from torchliner.duct.presets import duct_names, duct_text
    from torchliner.records.origin import origin_of
    from torchliner.report.fields import draw_field
    from torchliner.report.of_duct import of_field

    if options.duct is None:
        opt.require_alone(options, "name a duct")
        show(options, [*duct_names()], _presets)
        return
    if options.copy is not None:
        opt.require_alone(options, "leave --copy out to solve the duct", "duct", "copy")
        write_copy(duct_text(options.duct), options.copy)
        print(f"{options.copy}: preset {options.duct}")
        return
    setup = _setup(options)
    about: dict[str, Any] = {"places": setup.places, "wall": setup.wall}
    if options.mesh is not None:
        cell, *at_wall = options.mesh
        if len(at_wall) > 1:
            raise ValueError(f"--mesh has {len(options.mesh)} sizes; give the largest cell and that at the walls")
        about["mesh"] = build_mesh(
            setup.case, float(setup.frequency.max()), column=cell, row=cell, wall_cell=at_wall[0] if at_wall else None
        )
    field = tl.solve_settled(setup.case, setup.frequency, setup.impedance, **about)
    if options.field is not None:
        _each(setup, lambda picture, i: draw_field(setup, field, picture, i))(None, options.field)

    def write(path: Path) -> None:
        tables = (setup.facts["flow"]["file"], setup.facts["sound"]["impedance_file"])
        beside = [("table", Path(options.duct).parent / name) for name in tables if name is not None]
        files = [("duct", options.duct), ("liner", options.liner or ""), *beside]
        setup.line_of(field, **origin_of(files, command=options.typed)).write(path)

    show(
        options,
        of_field(field, setup),
        write=write,
    )


def modes(options: argparse.Namespace) -> None:
    """Wavenumbers of the lined duct.

    Pridmore-Brown modes above an infinite liner, both directions.
    """
    from torchliner.report.of_duct import of_modes

    setup = _setup(options)
    profile, f, about = setup.case.profile, setup.frequency, setup.case.slip_condition
    found = {
        direction: tl.duct_modes(
            profile, f, setup.first_wall, direction=direction, count=options.count, slip_condition=about
        )
        for direction in names.DIRECTIONS
    }
    show(options, of_modes(setup, found, tl.growing_wave(profile, f, setup.first_wall, about)))


def _each(setup: DuctSetup, draw: Callable[[Path, int], Any]) -> Callable[[Any, Path], None]:
    """Draws the picture of each frequency: the path itself for one, else NAME_1500Hz.png."""
    from torchliner.file_names import frequency_ends

    def drawn(_: Any, path: Path) -> None:
        for i, end in enumerate(frequency_ends(setup.frequency.tolist())):
            draw(path.with_stem(path.stem + end), i)

    return drawn


def _setup(options: argparse.Namespace) -> DuctSetup:
    """The duct with what the options change; all patches lined alike by --liner."""
    from torchliner.checks import tell
    from torchliner.fluid import gas_warnings

    if options.duct is None:
        raise ValueError("no duct is named; name a .toml file, or a preset that torchliner duct solve lists")
    setup = tl.load_duct(options.duct, **options.chosen)
    if options.liner is None:
        if options.speed is not None:
            raise ValueError("--speed is |v| at the liner that --liner names; name one")
        return setup
    if options.impedance is not None:
        raise ValueError("--impedance and --liner both state the wall; keep one")
    model = tl.load_liner(options.liner).in_flow(setup.case.profile.bulk_mach)
    if model.fluid is not None:
        tell(gas_warnings(model.fluid, setup.fluid, f"duct {setup.name}"))
    speed = options.speed or 0.0
    walls = model.impedance(setup.frequency, speed)[:, None].expand(-1, len(setup.case.liner))
    sound = {**setup.facts["sound"], "impedance": None, "impedance_file": None, "liner": options.liner, "speed": speed}
    return replace(setup, impedance=walls, facts={**setup.facts, "sound": sound})


def ir_tdibc(options: argparse.Namespace) -> None:
    """Print Z over level; draw."""
    from torchliner.report.answer import answer_of

    model = tl.load_liner(options.liner)
    incident = incident_signal(options)
    if incident is None and options.frequency is None:
        raise ValueError("nothing is sent; give --frequency of a tone, or --incident")
    if options.chosen.get("kernel") == "periodic" and (unused := sorted({"band", "after"} & options.chosen.keys())):
        raise ValueError(f"{opt.spelled(unused)}: of a kernel in time, which --kernel periodic has not; leave it out")
    wave, read = (options.frequency, None) if incident is None else (incident, options.frequency)
    with progress_bar(0, options.liner, options, "step") as step:
        curve = tl.ir_tdibc(model, options.level, wave, frequency=read, progress=step, **options.chosen)
    show(options, answer_of(curve))


def export(options: argparse.Namespace) -> None:
    """Print the poles, and how well they meet the map."""
    from torchliner.io.multipole_file import coefficients_of, plain_multipole

    model = tl.read_map(options.map).time_domain(options.poles, band=options.band, averaging=options.averaging)

    held = coefficients_of(model.poles, model.residues)
    rows = [(a, b, c / 2, -d / 2) for a, b, c, d in held["complex_poles"]]
    rows += [(a, 0.0, r, 0.0) for a, r in held["real_poles"]]
    lines = [
        f"R = 1 + sum r/(s - p) from {model.band[0]:g} to {model.band[1]:g} Hz: error in R at most {model.error:.2g}; "
        "stable and passive; poles with Im p > 0 have a conjugate with the conjugate residue\n",
        *("".join(f"{name:>15}" for name in ("-Re p, 1/s", "Im p, 1/s", "Re r, 1/s", "Im r, 1/s")),),
        *("".join(f"{value:15.6g}" for value in row) for row in rows),
    ]
    show(options, plain_multipole(model), lambda _: "\n".join(lines), model.write)


def wall(text: str) -> str | complex:
    """A hard wall, or its impedance."""
    return text if text == "rigid" else kinds.finite(text)


DUCT = [
    Option("duct", "preset or .toml file; without: list the presets", kinds.DUCT, nargs="?"),
    Option("--liner", "preset, .toml, .csv or .py file: Z(f) of a liner; default: --impedance", kinds.LINER),
    Option("--speed", "|v| at the liner, rms, with --liner; default 0", kinds.MPS),
]
WALL = Option("--impedance", "R+Xj or rigid, one a lined patch; default: the duct's", kinds.Kind("Z", wall), nargs="+")
FLOW = [
    opt.frequency("the duct's"),
    Option("--bulk-mach", "Mach number of the flow; default: the duct's", kinds.NUMBER),
    Option("--profile", "of the flow; default: the duct's", names.FLOW_PROFILES),
    Option("--shear", "of --profile tanh, half heights; default: the duct's", kinds.NUMBER),
    Option("--allow-thin", "take a shear below 0.03 too, to study it"),
    WALL,
]
SOUND = [
    Option("--level", "of the incident wave, dB re 20 uPa rms; default: the duct's", kinds.DB),
    Option("--source-side", "side that the sound comes from; default: the duct's", names.SOURCES),
    Option("--end-reflection", "of the far end, complex; default: the duct's", kinds.COMPLEX),
]
MESH = "largest cell, and cell at the walls, m: solve on that mesh alone; default: checked on a finer one, to 0.05 dB"
LEVEL = "of the whole incident wave, dB re 20 uPa rms"
COMMANDS: dict[str, Any] = {
    "liner": Command(
        liner,
        [
            Option("liners", "presets, .toml, .csv or .py files; without: list the presets", kinds.LINER, nargs="*"),
            opt.frequency(" ".join(f"{f:g}" for f in FREQUENCIES)),
            Option("--speed", "|v|, m/s; default 0 1 3 5", kinds.MPS, nargs="+"),
            *(opt.figure("draw Z over frequency there; of several liners the linear Z"), opt.COPY),
        ],
        ("onera --frequency 500:3000:500", "onera --copy mine.toml"),
    ),
    "duct": {
        "solve": Command(
            solve,
            [
                *(*DUCT, Option("--mesh", MESH, kinds.M, nargs="+"), opt.COPY),
                opt.output("write the microphones, for torchliner kt, and but for .csv report,", ".csv", *opt.HDF5),
                opt.figure("draw SPL and phase along the wall there, a picture a frequency"),
                Option("--field", "draw |p| and |v| in the duct there, a picture a frequency", kinds.PICTURE),
            ],
            ("b2a --frequency 1000:2000:500 --figure field.png -o b2a.h5",),
            [*FLOW, *SOUND],
        ),
        "modes": Command(
            modes,
            [
                *(*DUCT, opt.output("write the wavenumbers", ".csv")),
                Option("--count", "modes in each direction; default 4", kinds.COUNT, default=4),
                opt.figure("draw the modes' pressure over the height there, a picture a frequency"),
            ],
            ("b2a --frequency 1400",),
            FLOW,
        ),
    },
    "ir-tdibc": Command(
        ir_tdibc,
        [
            Option("liner", "preset, .toml, .csv or .py file", kinds.LINER),
            Option("--level", LEVEL, kinds.DB, nargs="+", required=True),
            *(opt.frequency("none; with --incident its tones, or eight in its band"), *opt.INCIDENT),
            *(opt.ROWS, opt.figure("draw R and X over level there")),
        ],
        (
            "lbm_slit --frequency 1400 --level 115 130 145 --figure z.png -o z.csv",
            "onera --incident noise:500:3000 --level 120 140 --realisations 8 --frequency 1000",
        ),
        opt.of(
            "velocity.ir_tdibc:ir_tdibc",
            "kernel drive realisations sampling_rate duration velocity_max band after",
            shown="kernel drive realisations sampling_rate duration",
            kernel={"kind": names.STEP_KERNELS},
            drive={"kind": names.STEP_DRIVES},
        ),
    ),
    "export": Command(
        export,
        [
            Option("map", "map of torchliner educe, of several frequencies", kinds.PATH),
            Option("--poles", "fewer than frequencies; default 8", kinds.COUNT, default=8),
            Option("--band", "lowest and highest frequency to fit; default all of the map", kinds.HZ, nargs=2),
            opt.averaging(None),
            opt.output("write poles and residues, or the coefficient lists of solvers as .txt,", ".json", ".txt"),
        ],
        ("map.h5 --poles 6 --band 500 3000 -o liner.json",),
    ),
}
