"""torchliner duct."""

from __future__ import annotations

import argparse
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

from torchliner.cli.options import (
    add_output_options,
    complex_number,
    frequencies,
    print_json,
    refuse_inputs,
    require_ending,
    warnings_on_stderr,
    write_copy,
)

if TYPE_CHECKING:
    from torchliner.duct.presets import DuctSetup

CHANGES = ("bulk_mach", "profile", "shear", "allow_thin", "level", "source_side")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """One parser a task; each is a word after ``duct``."""
    tasks = parser.add_subparsers(
        dest="task", metavar="TASK", required=True, parser_class=type(parser)
    )
    solve = tasks.add_parser(
        "solve", help="sound field of a lined duct with flow", allow_abbrev=False,
        description="Linearised Euler equations in two dimensions; SPL and phase at microphones.",
    )  # fmt: skip
    _add_duct(solve)
    solve.add_argument("--level", type=float, metavar="DB", help="of the incident wave")
    solve.add_argument("--source-side", choices=["upstream", "downstream"])
    solve.add_argument("--end-reflection", metavar="R", help="of the far end, complex")
    solve.add_argument(
        "-o", "--output", type=Path, help="microphones as .csv, .h5 or .nc, for torchliner kt"
    )
    solve.add_argument("--figure", type=Path, help="SPL and phase along the wall")
    solve.add_argument("--field", type=Path, metavar="PICTURE", help="draw |p| and |v| in the duct")
    solve.add_argument("--copy", type=Path, metavar="FILE", help="write the preset's TOML, to edit")
    add_output_options(solve)
    modes = tasks.add_parser(
        "modes", help="wavenumbers of the lined duct", allow_abbrev=False,
        description="Pridmore-Brown modes above an infinite liner, both directions.",
    )  # fmt: skip
    _add_duct(modes)
    modes.add_argument("--count", type=int, default=4, help="modes in each direction")
    modes.add_argument("-o", "--output", type=Path, help="wavenumbers as .csv")
    modes.add_argument("--figure", type=Path, help="draw the modes' pressure over the height")
    add_output_options(modes)


def _add_duct(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("duct", nargs="?", help="preset or .toml file; without: list the presets")
    parser.add_argument("--frequency", nargs="+", type=frequencies, metavar="HZ")
    parser.add_argument("--impedance", nargs="+", metavar="Z", help="R+Xj or rigid, one a lined "
                        "patch")  # fmt: skip
    parser.add_argument("--bulk-mach", type=float, metavar="M")
    parser.add_argument("--profile", choices=["uniform", "tanh", "parabolic", "law-of-the-wall"])
    parser.add_argument("--shear", type=float, metavar="D", help="of --profile tanh, half heights")
    parser.add_argument("--allow-thin", action="store_const", const=True,
                        help="take a shear below 0.03 too, to study it")  # fmt: skip


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
    with warnings_on_stderr(options.quiet):
        setup = _setup(options)
        return {"solve": _solve, "modes": _modes}[options.task](options, setup)


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
    for key in (*CHANGES, "frequency", "impedance", "end_reflection", "output", "figure", "field"):
        if getattr(options, key, None) is not None:
            raise ValueError(message.format(key.replace("_", "-")))


def _setup(options: argparse.Namespace) -> DuctSetup:
    from torchliner.duct.presets import load_duct

    changes: dict[str, Any] = {key: getattr(options, key, None) for key in CHANGES}
    changes = {key: value for key, value in changes.items() if value is not None}
    if options.frequency is not None:
        changes["frequency"] = list(chain(*options.frequency))
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

    require_ending(options.output, [".csv", ".h5", ".nc"], "--output")
    require_ending(options.field, [".png", ".pdf", ".svg"], "--field")
    refuse_inputs((options.output, options.field), (options.duct,), options.figure)
    keep = "all" if options.field is not None else "walls"
    solver = DuctSolver(setup.case, setup.frequency, keep=keep)
    field = solver.solve(setup.impedance)
    found = plain_duct(setup, field)
    if options.output is not None:
        solved_line(setup, field).write(options.output)
    if options.figure is not None:
        draw_walls([(setup, field)], options.figure)
    if options.field is not None:
        draw_field(setup, field, options.field)
    if options.json:
        print_json(found)
    else:
        print(format_duct(setup, found))
    return 0


def _modes(options: argparse.Namespace, setup: DuctSetup) -> int:
    from torchliner.duct.setup_modes import modes_of
    from torchliner.report.duct_modes import draw_modes, format_modes, mode_table

    require_ending(options.output, [".csv"], "--output")
    refuse_inputs((options.output,), (options.duct,), options.figure)
    modes = modes_of(setup, options.count)
    table = mode_table(setup, modes)
    if options.figure is not None:
        draw_modes(modes, options.figure)
    if options.output is not None:
        table.write_csv(options.output)
    if options.json:
        print_json({"duct": setup.facts, "modes": table.as_rows()})
    else:
        print(format_modes(setup, table))
    return 0
