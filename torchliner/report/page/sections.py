"""Sections that every page has: warnings, what was asked, where it comes from, how to cite it."""

from __future__ import annotations

import contextlib
import platform
import shlex
from collections.abc import Iterable, Iterator, Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.records.notes import Note
from torchliner.records.origin import described, input_file, standing
from torchliner.report.page.blocks import Block, Bullets, Code, Facts, Grid, Section, Text, shown
from torchliner.report.table import Column, Table
from torchliner.report.typesetting import typeset
from torchliner.version import __version__

FOOTER = (
    f"torchliner {__version__}. Impedances are normalised by ρc, with the time factor e^(+jωt) and "
    "the velocity into the liner."
)
FIRST = ("null-test", "level-check", "model-misfit")  # what makes Z another quantity, whatever its size
INPUT = {"what": str, "name": str, "bytes": int, "hash": str}  # of one that is stored
APART = ("inputs", "version", "versions", "command")  # choices that stand under provenance
PACKAGES = ("torch", "numpy", "scipy", "h5py")
MOST_LISTED = 8  # numbers in a cell
PAPER = (
    "R. Roncen, L. Ambrosiani, A. Paduano, F. Avallone, F. Méry and E. Piot, Direct time-domain "
    "eduction of acoustic liner impedance in turbulent grazing flows, Journal of Fluid Mechanics "
    "1042 (2026), doi:10.1017/jfm.2026.11969"
)
BIBTEX = f"""@article{{roncen2026,
  author  = {{Roncen, R\\'emi and Ambrosiani, Ludovico and Paduano, Angelo and Avallone, Francesco
             and M\\'ery, Fabien and Piot, Estelle}},
  title   = {{Direct time-domain eduction of acoustic liner impedance in turbulent grazing flows}},
  journal = {{Journal of Fluid Mechanics}}, volume = {{1042}}, year = {{2026}},
  doi     = {{10.1017/jfm.2026.11969}}
}}
@software{{torchliner,
  author  = {{{{The torchliner developers}}}}, title = {{torchliner}}, version = {{{__version__}}}
}}"""


def warned(notes: Iterable[Note | str]) -> Section:
    """Each once: what makes Z another quantity, then by how far Z may be off, then those of unknown size."""
    each = dict.fromkeys(Note("", note) if isinstance(note, str) else note for note in notes)
    ordered = sorted(each, key=lambda n: (n.code not in FIRST, n.size is None, -(n.size or 0.0)))
    items = [typeset(_begun(shown(note.text))) for note in ordered]
    sizes = ["" if n.size is None else typeset(f"may move Z by {n.size:.2g}") for n in ordered]
    listed: Block = Bullets(items, ordered=True, beside=sizes) if items else Text("None.")
    return Section("warnings", "Warnings", [listed])


def _begun(text: str) -> str:
    """With a capital, unless it begins with a name of a file."""
    return text[:1].upper() + text[1:] if text.split(" ")[0].strip(",:").isalpha() else text


def asked(choices: Mapping[str, Any], *more: Block) -> Section:
    """Every choice and number behind a result."""
    rows = [{"choice": name, "value": text} for name, text in _flat(choices, "")]
    columns = [Column(name, heading=name) for name in ("choice", "value")]
    grid = [Grid("choices", "Every choice behind the result.", Table(rows, columns))] if rows else []
    return Section("asked", "What was asked", [*more, *grid])


def _flat(values: Mapping[str, Any], before: str) -> Iterator[tuple[str, str]]:
    for key, value in values.items():
        if key in APART:
            continue
        if isinstance(value, Mapping):
            yield from _flat(value, f"{before}{shown(key)}, ")
        else:
            yield f"{before}{shown(key).replace('_', ' ')}", words(value)


def words(value: Any) -> str:
    """A value in one line; of many numbers their extent."""
    if value is None:
        return "none"
    if isinstance(value, bool):
        return ("no", "yes")[value]
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, list | tuple):
        numbers = np.zeros(0, str)
        if len(value) > MOST_LISTED:
            with contextlib.suppress(ValueError):  # lists of unlike lengths
                numbers = np.asarray(value)
        if numbers.size and numbers.dtype.kind in "if":
            shape = " x ".join(map(str, numbers.shape))
            return f"{shape} values, {numbers.min():.7g} to {numbers.max():.7g}"
        return ", ".join(map(words, value))
    return shown(value)


def inputs_of(*results: Any) -> list[Mapping[str, Any]]:
    """The inputs that results hold, each once; a file may hold anything of that name."""
    lists = [one.choices.get("inputs") for one in results]
    lists += [data.get("inputs") for one in results if isinstance(data := one.choices.get("data"), Mapping)]
    found = [each for one in lists if isinstance(one, list) for each in one]
    return [
        each
        for i, each in enumerate(found)
        if isinstance(each, Mapping)
        and all(isinstance(each.get(key), kind) for key, kind in INPUT.items())
        and each not in found[:i]
    ]


def changed(*results: Any) -> list[Note]:
    """Warnings of inputs that are no longer what they were."""
    found = [(each, standing(each)) for each in inputs_of(*results)]
    return [
        Note("changed-input", f"{each['what']}: {each['name']} is {now.words}; it is not what the result was made of")
        for each, now in found
        if now.changed
    ]


def origin(results: Sequence[Any], path: Path | None) -> Section:
    """Inputs with their hashes then and now, the file itself, the command, versions."""
    held, choices = inputs_of(*results), results[0].choices
    facts = [(shown(each["what"]), f"{shown(described(each))}; {standing(each).words}") for each in held]
    facts.append(("result", "in memory" if path is None else shown(described(input_file("result", path)))))
    made = choices.get("versions")
    made = dict(made) if isinstance(made, Mapping) else {"torchliner": choices.get("version")}
    here = {"torchliner": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            here[name] = version(name)
    for what, own in (("result made by", made), ("page made by", here)):
        facts.append((what, shown(", ".join(f"{k} {v or '(not stated)'}" for k, v in own.items()))))
    typed = [one.choices["command"] for one in results if isinstance(one.choices.get("command"), list)]
    lines = dict.fromkeys(shlex.join(["torchliner", *map(str, each)]) for each in typed)
    told: list[Block] = [Code("command", shown(line)) for line in lines]
    told = told or [Text("Done in Python: no command is kept, the choices are above.")]
    return Section("origin", "Inputs and provenance", [Facts(facts), *told])


def citation() -> Section:
    """Of the paper and of the package."""
    program = f"The program: The torchliner developers, torchliner, version {__version__}."
    return Section("cite", "Citation", [Text(f"The method: {PAPER}."), Text(program), Code("BibTeX", BIBTEX)])
