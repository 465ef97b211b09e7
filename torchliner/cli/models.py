"""Commands on pressures, models of liners and ducts: insitu, kt, liner, duct solve, duct modes, ir-tdibc, export."""

import argparse
from contextlib import suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import torch

import torchliner as tl
from torchliner import names
from torchliner.checks import tell
from torchliner.cli import work
from torchliner.cli.options import spelled
from torchliner.duct.mesh import build_mesh
from torchliner.duct.presets import DuctSetup, duct_names, duct_text
from torchliner.fluid import gas_warnings
from torchliner.io.result_writers import plain_multipole
from torchliner.liners.catalogue import preset_text
from torchliner.names import WALL_METHODS, resolve
from torchliner.records.origin import origin_of, with_choices
from torchliner.report.answer import Answer, Picture, answer_of
from torchliner.report.curves import draw_liner
from torchliner.report.of_duct import of_modes
from torchliner.report.of_line import of_pressures
from torchliner.report.table import table_of


def insitu(options: argparse.Namespace) -> None:
    """Impedance from pressures in situ, or at microphones in front of the liner."""
    pair: dict[str, Any] = {} if options.microphones is None else {"pair": tuple(options.microphones)}
    record = tl.read_pressure(options.record)
    answer, points = of_pressures(record, options.frequency, **options.chosen, **pair)
    if options.output is None or options.output.suffix.lower() == ".csv":
        work.show(options, answer)
    elif points is None:
        raise ValueError(f"{options.record} holds microphones alone: -o FILE.csv writes the rows")
    else:
        work.show(options, answer, with_choices(points, command=options.typed).write)


def kt(options: argparse.Namespace) -> None:
    """Impedance from microphones along a lined duct, by wavenumber or by fit."""
    home, _, taken = WALL_METHODS[options.method]
    own = {name for _, _, several in WALL_METHODS.values() for name in several}
    if foreign := own & options.chosen.keys() - set(taken):
        raise ValueError(f"{spelled(sorted(foreign))} is no option of --method {options.method}")
    found: list[Any] = []
    for path in options.lines:
        line = replace(tl.read_microphones(path, options.frequency, segment=options.segment), **options.facts)
        one = resolve(home)(line, **options.chosen)
        files = [("microphones", path), ("duct", options.chosen.get("duct", ""))]
        found.append(with_choices(one, **origin_of(files, command=options.typed)))
    answer = answer_of(found)

    def write(path: Path) -> None:
        if path.suffix.lower() == ".csv":
            answer.table.write_csv(path)
        else:
            found[0].write(path, *found[1:])

    work.show(options, answer, write)


FREQUENCIES = (500.0, 1000.0, 1400.0, 1500.0, 2000.0, 3000.0)


def liner(options: argparse.Namespace) -> None:
    """Geometry, resonance and impedance of a liner."""
    if options.liner is None:
        work.show(options, work.told(f"presets: {', '.join(tl.preset_names())}", tl.preset_names()))
        return
    if options.copy is not None:
        work.write_text(preset_text(options.liner), options.copy, anew=True)
    model, speeds = tl.load_liner(options.liner), options.speed
    facts: dict[str, Any] = model.describe()
    with suppress(ValueError, AttributeError):
        facts["resonance_hz"] = model.resonance()  # type: ignore[attr-defined]
    low, high = model.frequency_range or (0.0, float("inf"))
    inside = [f for f in options.frequency or FREQUENCIES if low <= f <= high]
    at = {f"{v:g} m/s": v for v in speeds}
    rows = [{"frequency": f, "impedance": {k: complex(model.impedance(f, v)) for k, v in at.items()}} for f in inside]
    title = f"liner model {Path(options.liner).stem}"
    answer = Answer(
        title=f"{title}, SI units; Z over rho c at |v| in m/s",
        lines=[work.facts_text(facts)],
        table=table_of(rows, "frequency" + "".join(f",impedance.{name}" for name in at)),
        pictures=[Picture("liner", "R and X.", partial(draw_liner, model, speeds, title), lambda: rows)],
        more={"liner": facts},
    )
    work.show(options, answer)


def duct_solve(options: argparse.Namespace) -> None:
    """Sound field of a lined duct with flow, SPL at microphones."""
    if options.duct is None:
        work.show(options, work.told(f"presets: {', '.join(duct_names())}", duct_names()))
        return
    if options.copy is not None:
        work.write_text(duct_text(options.duct), options.copy, anew=True)
        return
    setup = _setup(options)
    about: dict[str, Any] = {"places": setup.microphones, "wall": setup.wall}
    if options.mesh is not None:
        cell, wall_cell = (*options.mesh, None)[:2]
        highest = max(setup.frequency.tolist())
        about["mesh"] = build_mesh(setup.case, highest, column=cell, row=cell, wall_cell=wall_cell)
    field = tl.solve_settled(setup.case, setup.frequency, setup.impedance, **about)

    def write(path: Path) -> None:
        files = [("duct", options.duct), ("liner", options.liner or "")]
        if table := setup.facts["flow"]["file"]:
            files.append(("table", Path(options.duct).parent / table))
        setup.line_of(field, **origin_of(files, command=options.typed)).write(path)

    work.show(options, setup.line_of(field), write)


def duct_modes(options: argparse.Namespace) -> None:
    """Wavenumbers of a lined duct with flow, both directions."""
    setup = _setup(options)
    profile, f = setup.case.profile, setup.frequency
    wall = setup.impedance[..., 0] if setup.case.liner else torch.inf
    about = {"count": options.count, "slip_condition": setup.case.slip_condition}
    found = {each: tl.duct_modes(profile, f, wall, direction=each, **about) for each in names.DIRECTIONS}
    work.show(options, of_modes(setup, found))


def _setup(options: argparse.Namespace) -> DuctSetup:
    """The duct with what the options change; all patches lined alike by --liner."""
    setup = tl.load_duct(options.duct, **options.chosen)
    if options.liner is None:
        return setup
    if "impedance" in options.chosen:
        raise ValueError("--impedance and --liner both state the wall; keep one")
    model = tl.load_liner(options.liner).in_flow(setup.case.profile.bulk_mach)
    if model.fluid is not None:
        tell(gas_warnings(model.fluid, setup.fluid, f"duct {setup.name}"))
    walls = model.impedance(setup.frequency, options.speed)[:, None].expand(-1, len(setup.case.liner))
    sound = setup.facts["sound"] | {"impedance": None, "liner": options.liner, "speed": options.speed}
    return replace(setup, impedance=walls, facts={**setup.facts, "sound": sound})


def ir_tdibc(options: argparse.Namespace) -> None:
    """Impedance over level from the incident wave alone."""
    work.show(options, tl.ir_tdibc(tl.load_liner(options.liner), options.level, options.frequency, **options.chosen))


def export(options: argparse.Namespace) -> None:
    """Poles and residues of a map, for solvers in the time domain."""
    model = tl.read_map(options.map).time_domain(**options.chosen)
    title = f"R = 1 + sum r/(s - p) from {model.band[0]:g} to {model.band[1]:g} Hz: error in R at most "
    title += f"{model.error:.2g}; stable and passive; -o or --json has the poles"
    work.show(options, work.told(title, plain_multipole(model)), model.write)
