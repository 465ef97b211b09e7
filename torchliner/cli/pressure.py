"""Commands that measure an impedance from pressure: insitu, kt."""

from __future__ import annotations

import argparse
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

import torchliner as tl
from torchliner.cli.options import spelled
from torchliner.cli.show import show
from torchliner.names import WALL_METHODS, resolve
from torchliner.records.origin import origin_of, with_choices
from torchliner.report.answer import answer_of
from torchliner.report.of_line import of_pressures


def insitu(options: argparse.Namespace) -> None:
    """Impedance from pressures at facesheet and backplate, or two in the duct."""
    pair: dict[str, Any] = {} if options.microphones is None else {"pair": tuple(options.microphones)}
    record = tl.read_pressure(options.record)
    answer, points = of_pressures(record, options.frequency, **options.chosen, **pair)
    as_rows = options.output is None or options.output.suffix.lower() == ".csv"
    if points is None and not (as_rows and options.figure is None):
        raise ValueError(
            f"{options.record} holds microphones alone: there is nothing along x to draw or to write; -o FILE.csv "
            "writes the rows"
        )
    show(options, answer, None if as_rows or points is None else with_choices(points, command=options.typed).write)


def kt(options: argparse.Namespace) -> None:
    """Impedance from microphones along a lined duct, by wavenumber or by fit."""
    home, _, taken = WALL_METHODS[options.method]
    own = {name for _, _, several in WALL_METHODS.values() for name in several}
    if foreign := own & options.chosen.keys() - set(taken):
        raise ValueError(f"{spelled(sorted(foreign))} is no option of --method {options.method}")
    found: list[Any] = []
    for path in options.lines:
        line = replace(tl.read_microphones(path, options.frequency, segment=options.segment), **options.facts)
        generator = torch.Generator().manual_seed(options.seed)
        one = resolve(home)(line, generator=generator, **options.chosen)
        files = [("microphones", path), ("duct", options.chosen.get("duct", ""))]
        found.append(with_choices(one, **origin_of(files, command=options.typed)))
    answer = answer_of(found)

    def write(path: Path) -> None:
        if path.suffix.lower() == ".csv":
            answer.table.write_csv(path)
        else:
            found[0].write(path, *found[1:])

    show(options, answer, write)
