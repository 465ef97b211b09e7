"""A campaign as the user states it: planes by name patterns, liners, frequencies, choices."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any, get_type_hints

from pydantic import BeforeValidator, Field, create_model

from torchliner.file_checks import Strict, naming, one_of, parse_toml, read_text, validated
from torchliner.io.plane_format import PlaneRequest
from torchliner.names import SOURCE_SIDES, frequencies, unique_names
from torchliner.records.origin import series_of
from torchliner.velocity.choices import Choices

NAMED = ("points", "x", "z")  # fields of a request that may name files, FILE or FILE:VARIABLE
OWN = {"files", "liner", "in_situ"}  # fields of a table of planes that are neither facts nor of a request


def _listed(value: Any) -> Any:
    return value if isinstance(value, list) else [value]


def _in_hertz(value: Any) -> Any:
    found = (f for each in _listed(value) for f in frequencies(str(each)))
    return list(dict.fromkeys(found))  # ranges may overlap


Texts = Annotated[list[str], BeforeValidator(_listed)]
_REQUEST: Any = {name: (hint | None, None) for name, hint in get_type_hints(PlaneRequest).items()}
_CHOICES: Any = dict.fromkeys(get_type_hints(Choices), (Any, None))
RequestTable: Any = create_model("RequestTable", __base__=Strict, **_REQUEST)
ChoicesTable: Any = create_model("ChoicesTable", __base__=Strict, **_CHOICES)


class PlanesTable(RequestTable):  # type: ignore[misc]
    """A table ``[[planes]]``: files, and what they do not say; SI units."""

    files: Annotated[Texts, Field(min_length=1)]
    liner: str | None = None
    in_situ: str | None = None
    title: str | None = None
    height: float | None = Field(None, gt=0)
    frequency: float | None = Field(None, gt=0)
    source_side: Annotated[str, one_of(*SOURCE_SIDES)] | None = None
    incident_level: float | None = None
    mach: float | None = None
    displacement_thickness: float | None = Field(None, ge=0)


class CampaignTable(Strict):
    """The whole file."""

    title: str = ""
    output: str | None = None
    figures: bool = False
    planes: list[PlanesTable] = Field(min_length=1)
    liners: Texts = Field(default_factory=list)
    frequencies: Annotated[list[float], BeforeValidator(_in_hertz)] = Field(default_factory=list)  # none: the tones
    choices: ChoicesTable = ChoicesTable()


@dataclass(frozen=True)
class Case:
    """One plane of a campaign."""

    path: Path  # absolute
    name: str  # in files and tables; no other case has it
    shown: str  # the path as seen from the campaign's file
    facts: Mapping[str, Any]  # of ``VelocityPlane``, in the place of the file's
    request: Mapping[str, Any]  # of ``PlaneRequest``
    liners: Sequence[str]  # presets or paths; none: the one that the file names
    in_situ: Path | None  # pressure record of the same run
    files: Sequence[Path]  # of the plane: its own, and those that the request names


@dataclass(frozen=True)
class Campaign:
    """What ``read_campaign`` finds."""

    path: Path  # of the file
    output: Path  # folder for the results
    cases: Sequence[Case]
    choices: Sequence[dict[str, Any]]  # every combination of those of which several are stated
    stated: CampaignTable


def read_campaign(path: str | Path, output: str | Path | None = None) -> Campaign:
    """A campaign from its TOML file; paths in it begin at its folder, which an output that it states stays in.

    ``output`` takes the place of the one stated, by default ``NAME_results`` beside the file. A ValueError lists all
    mistakes.
    """
    path = Path(path)
    table = validated(CampaignTable, parse_toml(read_text(path), path), path)
    folder = path.absolute().parent
    target = Path(output) if output else folder / (table.output or f"{path.stem}_results")
    if not output and not target.resolve().is_relative_to(folder.resolve()):
        raise ValueError(f"{path}: output = {table.output!r} leads out of {folder}; if meant, give --output {target}")
    found: dict[Path, PlanesTable] = {}
    for each in table.planes:
        for match in (one for pattern in each.files for one in _matches(folder, pattern, path, target)):
            if match in found:
                raise ValueError(f"{path}: {match} is named twice among the planes; name it once")
            found[match] = each
    names = unique_names(found)
    cases = [_case(*each, name, table.liners, folder) for each, name in zip(found.items(), names, strict=True)]
    lists = {key: _listed(value) for key, value in table.choices.model_dump(exclude_unset=True).items()}
    sets = [dict(zip(lists, each, strict=True)) for each in itertools.product(*lists.values())]
    with naming(path):
        for one in sets:
            if one.get("interval") is False:  # None, for which TOML has no word
                one["interval"] = None
            Choices(**one)
    return Campaign(path, target, cases, sets, table)


def _matches(folder: Path, pattern: str, path: Path, output: Path) -> list[Path]:
    """The file of that very name, else the files of a pattern, sorted; one of each series, and none of the results;
    FileNotFoundError where there is none."""
    kept, covered, found = list[Path](), set[Path](), [folder / pattern]
    if not found[0].exists():
        found = [*map(Path, sorted(glob.glob(os.path.join(glob.escape(str(folder)), pattern), recursive=True)))]
    for each in found:
        if each not in covered and not each.absolute().is_relative_to(output.absolute()):
            kept.append(each)
            covered |= set(series_of(each))
    if not kept:
        but = f" but results in {output}; name another --output" if found else ""
        raise FileNotFoundError(f"{path}: planes.files = {pattern!r} matches nothing in {folder}{but}")
    return kept


def _case(path: Path, table: Any, name: str, liners: list[str], folder: Path) -> Case:
    """One plane of a table; ``liners`` of the whole campaign win, paths begin at ``folder``."""
    facts = table.model_dump(exclude_none=True, exclude=OWN)
    request = {field.name: facts.pop(field.name) for field in fields(PlaneRequest) if field.name in facts}
    files = [path]
    for key in NAMED:
        words = request.get(key, "")
        named = [folder / each for each in (words, words.rpartition(":")[0]) if (folder / each).is_file()]
        if named:
            request[key] = str(folder / words)
            files += named
    found = []
    for each in liners or ([] if table.liner is None else [table.liner]):
        if Path(each).suffix.lower() == ".py":
            raise ValueError(f"liner {each} is a program, which no campaign runs; give its values as .csv")
        found.append(str(folder / each) if Path(each).suffix.lower() in (".toml", ".csv") else each)
    shown = str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)
    beside = None if table.in_situ is None else folder / table.in_situ
    return Case(path, name, shown, facts, request, found, beside, files)
