"""torchliner duct."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from torchliner import names
from torchliner.cli.files import show_results, write_copy
from torchliner.cli.options import complex_number, frequency_option, shared, stated

if TYPE_CHECKING:
    from torchliner.duct.presets import DuctSetup

CHANGES = ("bulk_mach", "profile", "shear", "allow_thin", "level", "source_side", "frequency")

DUCT = {
    "duct [DUCT]": "preset or .toml file; without: list the presets",
    **frequency_option("the duct's"),
    "--impedance Z ...": "R+Xj or rigid, one a lined patch; default: the duct's",
    "--bulk-mach M": "Mach number of the flow; default: the duct's",
    "--profile": (names.FLOW_PROFILES, "of the flow; default: the duct's"),
    "--shear D": "of --profile tanh, half heights; default: the duct's",
    "--allow-thin": "take a shear below 0.03 too, to study it",
}
SOLVE = {
    "--level DB": "of the incident wave, dB re 20 uPa rms; default: the duct's",
    "--source-side": (names.SOURCES, "side that the sound comes from; default: the duct's"),
    "--end-reflection R+XJ": "of the far end, complex; default: the duct's",
    "--output FILE": "write the microphones as .csv, .h5 or .nc, for torchliner kt",
    "--figure PICTURE": "draw SPL and phase along the wall there",
    "--field PICTURE": "draw |p| and |v| in the duct there",
}
MODES = {
    "--count N": {"default": 4, "help": "modes in each direction; default 4"},
    "--output FILE": "write the wavenumbers as .csv",
    "--figure PICTURE": "draw the modes' pressure over the height there",
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
    if options.duct is None and copy is None:
        _no_option(options, "a duct is needed with --{}; presets: " + ", ".join(duct_names()))
        print("presets: " + ", ".join(duct_names()))
        return 0
    if copy is not None:
        _only_copied(options, duct_names())
        write_copy(duct_text(options.duct), options.copy)
        print(f"{options.copy}: preset {options.duct}")
        return 0
    return {"solve": _solve, "modes": _modes}[options.task](options, _setup(options))


def _only_copied(options: argparse.Namespace, presets: list[str]) -> None:
    """The preset as it stands is copied: what would change it, or be made of it, is refused.

    Raises:
        ValueError: another option, no preset.
    """
    if options.duct not in presets:
        named = "none is named" if options.duct is None else f"{options.duct!r} is none"
        raise ValueError(f"--copy writes a preset, {' or '.join(presets)}; {named}")
    _no_option(
        options,
        "--copy writes the preset as it stands, without --{}; edit the copy, or leave one of them "
        "out",
    )


def _no_option(options: argparse.Namespace, message: str) -> None:
    others = ("impedance", "end_reflection", "output", "figure", "field")
    for key in stated(options, (*CHANGES, *others)):
        raise ValueError(message.format(key.replace("_", "-")))


def _setup(options: argparse.Namespace) -> DuctSetup:
    from torchliner.duct.presets import load_duct

    changes: dict[str, Any] = stated(options, CHANGES)
    if getattr(options, "end_reflection", None) is not None:
        changes["end_reflection"] = complex_number(options.end_reflection, "--end-reflection")
    if options.impedance is not None:
        hard = "'rigid' for a hard wall, or "
        changes["impedance"] = [
            text if text == "rigid" else complex_number(text, "--impedance", hard)
            for text in options.impedance
        ]
    return load_duct(options.duct, **changes)


def _solve(options: argparse.Namespace, setup: DuctSetup) -> int:
    from torchliner.lee.solved_line import solved_line
    from torchliner.lee.solver import DuctSolver
    from torchliner.report.duct_report import draw_field, draw_walls, format_duct, plain_duct

    keep = "all" if options.field is not None else "walls"
    solver = DuctSolver(setup.case, setup.frequency, keep=keep)
    field = solver.solve(setup.impedance)
    found = plain_duct(setup, field)
    if options.field is not None:
        draw_field(setup, field, options.field)
    show_results(
        options, lambda: format_duct(setup, found), lambda: found,
        output=lambda path: solved_line(setup, field).write(path),
        figure=lambda path: draw_walls([(setup, field)], path),
    )  # fmt: skip
    return 0


def _modes(options: argparse.Namespace, setup: DuctSetup) -> int:
    from torchliner.duct.setup_modes import modes_of
    from torchliner.report.duct_modes import draw_modes, format_modes, mode_table

    modes = modes_of(setup, options.count)
    table = mode_table(setup, modes)
    show_results(
        options, lambda: format_modes(setup, table),
        lambda: {"duct": setup.facts, "modes": table.as_rows()},
        output=table.write_csv, figure=lambda path: draw_modes(modes, path),
    )  # fmt: skip
    return 0
