"""Where a result comes from: files and their hashes, commands, versions; how to cite it."""

from __future__ import annotations

import hashlib
import json
import platform
import shlex
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from torchliner.records import ImpedanceMap
from torchliner.report.page.blocks import Block, Code, Facts, Text, shown
from torchliner.report.page.subject import MapSubject, base_choices
from torchliner.version import __version__

MOST_HASHED = 4 << 30  # bytes of a file that is read for its hash
PIECE = 1 << 22
PACKAGES = ("torch", "numpy", "scipy", "h5py")
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


def hash_of(path: Path | None) -> str:
    """SHA-256 of a file as it is now, or why there is none."""
    if path is None or not path.is_file():
        return "not there now" if path is not None else "in memory"
    if path.stat().st_size > MOST_HASHED:
        return f"not made: {path.stat().st_size / 1e9:.3g} GB (sha256sum makes it)"
    found = hashlib.sha256()
    with path.open("rb") as file:
        while piece := file.read(PIECE):
            found.update(piece)
    return found.hexdigest()


def files_of(
    files: Sequence[tuple[str, Path | None, str]],
    words: str = "Files with their hashes as they are now; a result does not keep those of its "
    "data.",
) -> list[Block]:
    """Files by what they are, with size and hash, below some words."""
    facts = []
    for what, path, name in files:
        there = path is not None and path.is_file()
        size = f", {path.stat().st_size:,} bytes" if there and path is not None else ""
        facts.append((what, f"{shown(name or path or '')}{size}; SHA-256: {hash_of(path)}"))
    return [*([Text(words)] if words else []), Facts(facts)]


def hashed_then(inputs: Mapping[str, str], commands: Sequence[str]) -> list[Block]:
    """Inputs with their hashes, and the commands that read them.

    Args:
        inputs: SHA-256 by file, as it was when it was read; "" where that was not kept.
        commands: "" for what was done in Python.
    """
    facts = []
    for name, then in inputs.items():
        now = hash_of(Path(name))
        words = f"SHA-256 now: {now}; that of then was not kept"
        if then:
            state = "the same now" if now == then else f"now: {now}"
            words = f"SHA-256 when it was read: {then}; {state}"
        facts.append((shown(name), words))
    blocks: list[Block] = [Facts(facts)] if facts else []
    typed = [command for command in dict.fromkeys(commands) if command]
    if not typed:
        return [*blocks, Text("Done in Python: no command is kept, the choices are above.")]
    return [*blocks, *(Code("command", shown(command)) for command in typed)]


def source_of(result: Any) -> Path | None:
    """The file that a map says it was educed from."""
    name = str(result.choices.get("source", "")).split(":/")[0]
    return Path(name) if name else None


def origin(subject: MapSubject) -> list[Block]:
    """Of a map."""
    result = subject.result
    source = source_of(result)
    files = [("map", subject.path, "" if subject.path else "this map, in memory")]
    files += [("velocity", source, str(source))] if source is not None else []
    files += [(other.name, Path(found), found) for other in result.alongside
              if (found := str(other.choices.get("source", "")))]  # fmt: skip
    if subject.data is not None and subject.data != source:
        files.append(("data of this report", subject.data, str(subject.data)))
    return [*files_of(files), _stated(result.choices.get("data")), *command(subject),
            versions(result.choices.get("version"))]  # fmt: skip


def _stated(data: Any) -> Block:
    if not isinstance(data, Mapping) or not data:
        return Text("The data state nothing of their own origin.")
    words = [(str(key).replace("_", " "), shown(v if isinstance(v, str) else json.dumps(v)))
             for key, v in data.items()]  # fmt: skip
    return Facts(words)


def versions(made: Any) -> Facts:
    """Of what made the result and of what made the page."""
    found = [
        ("result made by torchliner", shown(made or "not stated")),
        ("page made by torchliner", __version__), ("Python", platform.python_version()),
    ]  # fmt: skip
    for name in PACKAGES:
        try:
            found.append((name, version(name)))
        except PackageNotFoundError:
            continue
    return Facts(found)


def command(subject: MapSubject) -> list[Block]:
    """What gives this map again, on the command line and in Python."""
    result = subject.result
    source = source_of(result)
    if source is None:
        return [Text("The map does not say which file it was educed from.")]
    chosen = base_choices(result)
    liner = "LINER.toml"
    if subject.model is not None:
        liner = str(result.choices["liner"].get("name") or liner)
    asked = [float(f) for f in result.frequency.tolist()]
    words = ["torchliner", "educe", str(source), "--liner", liner]
    words += ["--frequency", *(f"{f:.12g}" for f in asked)]
    for key, value in chosen.items():
        words += _option(key, value)
    beside = next((str(o.choices["source"]) for o in result.alongside if "source" in o.choices), "")
    words += ["--in-situ", beside] if beside else []
    words += ["-o", str(subject.path or "map.h5")]
    arguments = [
        f"tl.read_plane({str(source)!r}, lazy=True)",
        f"tl.load_liner({liner!r})",
        repr(asked),
    ]
    arguments += [f"{key}={value!r}" for key, value in chosen.items()]
    arguments += [f"pressure=tl.read_pressure({beside!r})"] if beside else []
    body = ",\n    ".join(arguments)
    lost = _incomplete(result, bool(beside), subject.model is None)
    return [
        Text(f"The map again, from its own record of its choices. {lost}".strip()),
        Code("command", " ".join(map(shlex.quote, words))),
        Code("Python", f"import torchliner as tl\n\nfound = tl.educe(\n    {body},\n)"),
    ]


def _option(key: str, value: Any) -> list[str]:
    """Of the command line."""
    if key == "interval" and value is None:
        return ["--no-intervals"]
    flag = f"--{key.replace('_', '-')}"
    if value is True:
        return [flag]
    values = value if isinstance(value, (list, tuple)) else [value]
    return [flag, *(f"{v:.12g}" if isinstance(v, float) else str(v) for v in values)]


def _incomplete(result: ImpedanceMap, beside: bool, unknown: bool) -> str:
    """What the map does not keep of the command that made it."""
    found = []
    if unknown:
        found.append("the file of the liner, whose numbers are listed above")
    if result.choices.get("phase") == "given":
        found.append("the reference phase")
    if result.closure is not None and result.closure.kind == "wall" and not beside:
        found.append("the file of the wall pressures (--wall-pressure)")
    if result.choices.get("incident") is not None:
        found.append("the samples of an incident signal from a file")
    return f"The record does not hold {', '.join(found)}." if found else ""


def citation(_: Any = None) -> list[Block]:
    """Of the paper and of the package."""
    return [
        Text(f"The method: {PAPER}."),
        Text(f"The program: The torchliner developers, torchliner, version {__version__}."),
        Code("BibTeX", BIBTEX),
    ]
