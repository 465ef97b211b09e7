"""Where a result comes from: files and their hashes, versions; how to cite it."""

from __future__ import annotations

import contextlib
import json
import platform
import shlex
from collections.abc import Mapping, Sequence
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

from torchliner.records.origin import KINDS, input_file, standing
from torchliner.report.page.blocks import Block, Code, Facts, Text, shown
from torchliner.report.page.repeat import command, source_of
from torchliner.report.page.subject import MapSubject, inputs_of
from torchliner.version import __version__

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
BESIDE = "Files beside it as they are now; the result does not hold the hashes of its inputs."


def files_of(held: Sequence[Mapping[str, Any]], files: Sequence[tuple[str, Path | None, str]]) -> list[Block]:
    """The inputs that a result holds, then other files as they are now, with sizes and hashes.

    Args:
        held: of ``inputs_of``.
        files: what each is, its path, and words where it has none.
    """
    names = {str(each["name"]) for each in held}
    uses: dict[str, list[str]] = {}  # of one file there may be several
    for each in held:
        uses.setdefault(f"{_described(each)}; {standing(each).words}", []).append(each["what"])
    facts = [(shown(", ".join(what)), words) for words, what in uses.items()]
    facts += [(what, _now(what, path, name)) for what, path, name in files if str(path) not in names]
    lead = "Inputs as they were when the result was made, and whether they are the same now."
    return [Text(lead if held else BESIDE), Facts(facts)]


def typed(commands: Sequence[Any]) -> list[Block]:
    """Commands as they were typed, each a list of words; what has none was done in Python."""
    lines = [shlex.join(["torchliner", *map(str, each)]) for each in commands if isinstance(each, list)]
    if not lines:
        return [Text("Done in Python: no command is kept, the choices are above.")]
    return [Code("command", shown(line)) for line in dict.fromkeys(lines)]


def _described(each: Mapping[str, Any]) -> str:
    kind = KINDS.get(each["kind"], each["kind"])
    return shown(f"{each['name']}, {each['bytes']:,} bytes; {kind}: {each['hash']}")


def _now(what: str, path: Path | None, name: str) -> str:
    if path is None:
        return f"{shown(name)}; no file"
    if not (path.is_file() or path.is_dir()):
        return f"{shown(name or path)}; not there now"
    return _described(input_file(what, path))


def origin(subject: MapSubject) -> list[Block]:
    """Of a map."""
    result = subject.result
    files = [("map", subject.path, "" if subject.path else "this map, in memory")]
    if not inputs_of(result):
        source = source_of(result)
        files += [("velocity", source, "")] if source is not None else []
        files += [(other.name, Path(found), "") for other in result.alongside
                  if (found := str(other.choices.get("source", "")))]  # fmt: skip
    if subject.data is not None and subject.data not in [path for _, path, _ in files]:
        files.append(("data of this report", subject.data, ""))
    return [*files_of(inputs_of(result), files), stated_origin(result.choices.get("data")),
            *command(subject), versions(result)]  # fmt: skip


def stated_origin(data: Any) -> Block:
    """What the data say of their own origin."""
    if not isinstance(data, Mapping) or not data:
        return Text("The data state nothing of their own origin.")
    words = [(str(key).replace("_", " "), shown(v if isinstance(v, str) else json.dumps(v)))
             for key, v in data.items() if key != "inputs"]  # fmt: skip
    return Facts(words)


def versions(result: Any) -> Facts:
    """Of what made the result, as far as it holds them, and of what made the page."""
    choices = getattr(result, "choices", {})
    made = choices.get("versions")
    made = dict(made) if isinstance(made, Mapping) else {"torchliner": choices.get("version")}
    here = {"torchliner": __version__, "python": platform.python_version()}
    for name in PACKAGES:
        with contextlib.suppress(PackageNotFoundError):
            here[name] = version(name)
    return Facts([
        (f"{what} made by", shown(", ".join(f"{k} {v or '(not stated)'}" for k, v in own.items())))
        for what, own in (("result", made), ("page", here))
    ])  # fmt: skip


def citation(_: Any = None) -> list[Block]:
    """Of the paper and of the package."""
    return [
        Text(f"The method: {PAPER}."),
        Text(f"The program: The torchliner developers, torchliner, version {__version__}."),
        Code("BibTeX", BIBTEX),
    ]
