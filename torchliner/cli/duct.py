"""torchliner duct."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner import names
from torchliner.cli.files import show_results, write_copy
from torchliner.cli.options import complex_number, frequency_option, shared, stated
from torchliner.file_names import frequency_ends

if TYPE_CHECKING:
    from torchliner.duct.mesh import DuctMesh
    from torchliner.duct.presets import DuctSetup

CHANGES = ("bulk_mach", "profile", "shear", "allow_thin", "level", "source_side", "frequency")

DUCT = {
    "duct [DUCT]": "preset or .toml file; without: list the presets",
    **frequency_option("the duct's"),
    "--impedance Z ...": "R+Xj or rigid, one a lined patch; default: the duct's",
    "--liner LINER": "preset, .toml, .csv or .py file: Z(f) of a liner; default: --impedance",
    "--speed M/S": "|v| at the liner, rms, with --liner; default 0",
    "--bulk-mach M": "Mach number of the flow; default: the duct's",
    "--profile": (names.FLOW_PROFILES, "of the flow; default: the duct's"),
    "--shear D": "of --profile tanh, half heights; default: the duct's",
    "--allow-thin": "take a shear below 0.03 too, to study it",
}
SOLVE = {
    "--level DB": "of the incident wave, dB re 20 uPa rms; default: the duct's",
    "--source-side": (names.SOURCES, "side that the sound comes from; default: the duct's"),
    "--end-reflection R+XJ": "of the far end, complex; default: the duct's",
    "--mesh MM ...": "largest cell, and cell at the walls, mm: solve on that mesh alone; default: "
    "a finer mesh checks the answer, to 0.05 dB",
    "--output FILE": "write the microphones as .csv, .h5 or .nc, for torchliner kt; .h5 and .nc "
    "for torchliner report too",
    "--figure PICTURE": "draw SPL and phase along the wall there, a picture a frequency",
    "--field PICTURE": "draw |p| and |v| in the duct there, a picture a frequency",
}
MODES = {
    "--count N": {"default": 4, "help": "modes in each direction; default 4"},
    "--output FILE": "write the wavenumbers as .csv",
    "--figure PICTURE": "draw the modes' pressure over the height there, a picture a frequency",
}
TASKS = {
    "solve": (
        "sound field of a lined duct with flow",
        "Linearised Euler equations in two dimensions; SPL and phase at microphones.",
        {"": DUCT | SOLVE | shared("--copy", "--json", "--quiet")},
    ),
    "modes": (
        "wavenumbers of the lined duct",
        "Pridmore-Brown modes above an infinite liner, both directions.",
        {"": DUCT | MODES | shared("--json", "--quiet")},
    ),
}


def run(options: argparse.Namespace) -> int:
    """The task named after ``duct``."""
    from torchliner.duct.presets import duct_names, duct_text

    copy = getattr(options, "copy", None)
    if copy is None and options.duct is not None:
        return {"solve": _solve, "modes": _modes}[options.task](options, _setup(options))
    others = ("impedance", "liner", "speed", "mesh", "end_reflection", "output", "figure", "field")
    for key in stated(options, (*CHANGES, *others)):
        what = "--copy writes the preset as it stands" if copy is not None else "the list of presets has no options"
        raise ValueError(f"{what}: leave --{key.replace('_', '-')} out, or name a duct to solve")
    if copy is not None:
        write_copy(duct_text(options.duct or ""), copy)
    print(f"{copy}: preset {options.duct}" if copy is not None else "presets: " + ", ".join(duct_names()))
    return 0


def _setup(options: argparse.Namespace) -> DuctSetup:
    from torchliner.duct.presets import load_duct

    changes: dict[str, Any] = stated(options, CHANGES)
    if getattr(options, "end_reflection", None) is not None:
        changes["end_reflection"] = complex_number(options.end_reflection, "--end-reflection")
    if options.impedance is not None:
        hard = "'rigid' for a hard wall, or "
        changes["impedance"] = [
            text if text == "rigid" else complex_number(text, "--impedance", hard) for text in options.impedance
        ]
    if options.liner is None:
        if options.speed is not None:
            raise ValueError("--speed is |v| at the liner that --liner names; name one")
        return load_duct(options.duct, **changes)
    if options.impedance is not None:
        raise ValueError("--impedance and --liner both state the wall; keep one")
    return _with_liner(load_duct(options.duct, **changes), options.liner, options.speed or 0.0)


def _with_liner(setup: DuctSetup, name: str, speed: float) -> DuctSetup:
    """All patches lined alike, by Z(f) of a liner at |v| = speed, m/s."""
    from torchliner.checks import tell
    from torchliner.fluid import gas_warnings
    from torchliner.liners.catalogue import load_liner

    liner = load_liner(name).in_flow(setup.case.profile.bulk_mach)
    if liner.fluid is not None:
        tell(gas_warnings(liner.fluid, setup.fluid, f"duct {setup.name}"))
    walls = liner.impedance(setup.frequency, speed)
    walls_of = {"impedance": None, "impedance_file": None, "liner": name, "speed": speed}
    sound = {**setup.facts["sound"], **walls_of}
    facts = {**setup.facts, "sound": sound}
    patches = len(setup.case.liner)
    return replace(setup, impedance=walls[:, None].expand(-1, patches), facts=facts)


def _solve(options: argparse.Namespace, setup: DuctSetup) -> int:
    from torchliner.duct.settled import solve_settled
    from torchliner.duct.solved_line import solved_line
    from torchliner.records.origin import origin_of
    from torchliner.report.duct_report import draw_field, draw_walls, format_duct, plain_duct

    field = solve_settled(
        setup.case, setup.frequency, setup.impedance, places=setup.places,
        wall=setup.wall, mesh=_mesh(options.mesh, setup),
    )  # fmt: skip
    found = plain_duct(setup, field)
    tables = (setup.facts["flow"]["file"], setup.facts["sound"]["impedance_file"])
    beside = [Path(options.duct).parent / name for name in tables if name is not None]
    named = [
        ("duct", options.duct),
        ("liner", options.liner or ""),
        *(("table", p) for p in beside),
    ]
    origin = origin_of(named, command=options.typed)
    if options.field is not None:
        for f, path in enumerate(_a_frequency(options.field, setup)):
            draw_field(setup, field, path, f)

    def draw(picture: Path) -> None:
        for f, path in enumerate(_a_frequency(picture, setup)):
            draw_walls([(setup, field)], path, f)

    show_results(
        options, lambda: format_duct(setup, found), lambda: found,
        output=lambda path: solved_line(setup, field, **origin).write(path),
        figure=draw,
    )  # fmt: skip
    return 0


def _mesh(sizes: list[float] | None, setup: DuctSetup) -> DuctMesh | None:
    """Of the largest cell and the one at the walls, in mm."""
    from torchliner.duct.mesh import build_mesh

    if sizes is None:
        return None
    if len(sizes) > 2:
        raise ValueError(f"--mesh has {len(sizes)} sizes; write the largest cell and the wall's")
    metres = [1e-3 * size for size in sizes]
    return build_mesh(
        setup.case, float(setup.frequency.max()), column=metres[0], row=metres[0],
        wall_cell=metres[1] if len(metres) > 1 else None,
    )  # fmt: skip


def _a_frequency(path: Path, setup: DuctSetup) -> list[Path]:
    """The picture of each frequency: the path itself for one, else NAME_1500Hz.png."""
    return [path.with_stem(path.stem + end) for end in frequency_ends(setup.frequency.tolist())]


def _modes(options: argparse.Namespace, setup: DuctSetup) -> int:
    from torchliner.duct.growing_wave import growing_wave
    from torchliner.duct.modes import duct_modes
    from torchliner.report.duct_report import draw_modes, format_modes, mode_table

    wall, condition = setup.first_wall, setup.case.slip_condition
    about: dict[str, Any] = {"count": options.count, "slip_condition": condition}
    modes = {
        direction: duct_modes(setup.case.profile, setup.frequency, wall, direction=direction, **about)
        for direction in names.DIRECTIONS
    }
    table = mode_table(setup, modes, growing_wave(setup.case.profile, setup.frequency, wall, condition))

    def draw(picture: Path) -> None:
        for f, path in enumerate(_a_frequency(picture, setup)):
            draw_modes(modes, path, f)

    show_results(
        options, lambda: format_modes(setup, table),
        lambda: {"duct": setup.facts, "modes": table.as_rows()},
        output=table.write_csv, figure=draw,
    )  # fmt: skip
    return 0
