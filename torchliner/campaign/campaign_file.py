"""A campaign as the user states it: planes by name patterns, liners, frequencies, choices."""

from __future__ import annotations

import glob
import itertools
import os
from collections.abc import Mapping
from dataclasses import dataclass, fields
from pathlib import Path
from typing import Annotated, Any

from pydantic import BeforeValidator, Field, create_model, model_validator

from torchliner.file_checks import Strict, one_of, parse_toml, read_text, validated
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


class PlanesTable(Strict):
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
    variable: str | None = None
    group: str | None = None
    axes: list[str] | None = None
    velocity_units: str | None = None
    length_units: str | None = None
    sampling_rate: float | None = Field(None, gt=0)
    normal: str | None = None
    wall_normal_component: bool | None = None
    x: str | None = None
    z: str | None = None
    points: str | None = None


_NAMES = [field.name for field in fields(Choices)]
ChoicesTable: type[Strict] = create_model("ChoicesTable", __base__=Strict, **dict.fromkeys(_NAMES, (Any, None)))  # type: ignore[call-overload]


class CampaignTable(Strict):
    """The whole file."""

    title: str = ""
    output: str | None = None
    figures: bool = False
    planes: list[PlanesTable] = Field(min_length=1)
    liners: Texts = Field(default_factory=list)
    frequencies: Annotated[list[float], BeforeValidator(_in_hertz)] = Field(default_factory=list)
    choices: ChoicesTable = ChoicesTable()  # type: ignore[valid-type]

    @model_validator(mode="after")
    def _check_choices(self) -> CampaignTable:
        for each in choice_sets(self.choices.model_dump(exclude_unset=True)):  # type: ignore[attr-defined]
            try:
                Choices(**each)
            except TypeError as error:
                raise ValueError(f"choices: {error}") from None
        return self


@dataclass(frozen=True)
class Case:
    """One plane of a campaign."""

    path: Path  # absolute
    name: str  # in files and tables; no other case has it
    shown: str  # the path as seen from the campaign's file
    facts: Mapping[str, Any]  # of ``VelocityPlane``, in the place of the file's
    request: Mapping[str, Any]  # of ``PlaneRequest``
    liners: tuple[str, ...]  # presets or paths; none: the one that the file names
    in_situ: Path | None  # pressure record of the same run

    def files(self) -> list[Path]:
        """Of the plane: its own, and those that the request names."""
        named = (Path(each) for key in NAMED for each in _file_names(self.request.get(key, "")))
        return [self.path, *(each for each in named if each.is_file())]


@dataclass(frozen=True)
class Campaign:
    """What ``read_campaign`` finds."""

    path: Path  # of the file
    output: Path  # folder for the results
    cases: tuple[Case, ...]
    frequencies: tuple[float, ...]  # Hz; none: the tone of each plane
    choices: tuple[tuple[dict[str, Any], dict[str, Any]], ...]  # sets of them, each with what varies between the sets
    title: str
    figures: bool


def choice_sets(stated: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Every combination of values of which some are lists; ``interval = false`` is None, for which TOML has no word."""
    lists = {key: _listed(value) for key, value in stated.items()}
    sets = [dict(zip(lists, each, strict=True)) for each in itertools.product(*lists.values())]
    return [{k: None if k == "interval" and v is False else v for k, v in each.items()} for each in sets]


def read_campaign(path: str | Path, output: str | Path | None = None) -> Campaign:
    """A campaign from its TOML file; paths in it begin at its folder.

    Args:
        path: TOML.
        output: folder for the results, in the place of the one stated; default ``NAME_results`` beside the file.
    Raises:
        FileNotFoundError: no such file; a pattern that no file matches.
        ValueError: mistakes, all of them listed; a file that is named twice; a stated output outside of the folder.
    """
    path = Path(path)
    tables: dict[str, type[Strict]] = {"planes": PlanesTable, "choices": ChoicesTable}
    table = validated(CampaignTable, parse_toml(read_text(path), path), path, tables)
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
    sets = choice_sets(table.choices.model_dump(exclude_unset=True))  # type: ignore[attr-defined]
    varied = {key for key in sets[0] if len({repr(one[key]) for one in sets}) > 1}
    choices = tuple((one, {key: one[key] for key in one if key in varied}) for one in sets)
    return Campaign(path, target, tuple(cases), tuple(table.frequencies), choices, table.title, table.figures)


def _matches(folder: Path, pattern: str, path: Path, output: Path) -> list[Path]:
    """The file of that very name, else the files of a pattern, sorted; one of each series, and none of the results.

    Raises:
        FileNotFoundError: none.
    """
    found = [folder / pattern]
    if not found[0].exists():
        found = [*map(Path, sorted(glob.glob(os.path.join(glob.escape(str(folder)), pattern), recursive=True)))]
    kept: list[Path] = []
    covered: set[Path] = set()
    for each in found:
        if each not in covered and not each.absolute().is_relative_to(output.absolute()):
            kept.append(each)
            covered |= set(series_of(each))
    if not kept:
        but = f" but results in {output}; name another --output" if found else ""
        raise FileNotFoundError(f"{path}: planes.files = {pattern!r} matches nothing in {folder}{but}")
    return kept


def _case(path: Path, table: PlanesTable, name: str, liners: list[str], folder: Path) -> Case:
    """One plane of a table; ``liners`` of the whole campaign win, paths begin at ``folder``."""
    facts = table.model_dump(exclude_none=True, exclude=OWN)
    request = {field.name: facts.pop(field.name) for field in fields(PlaneRequest) if field.name in facts}
    for key in NAMED:
        if any((folder / each).is_file() for each in _file_names(request.get(key, ""))):
            request[key] = str(folder / request[key])
    named = liners or ([] if table.liner is None else [table.liner])
    for each in named:
        if Path(each).suffix.lower() == ".py":
            raise ValueError(
                f"liner {each} is a program, which no campaign runs; give its values as .csv (frequency, speed, "
                "resistance, reactance), or name it on the command line of educe"
            )
    found = [str(folder / each) if Path(each).suffix.lower() in (".toml", ".csv") else each for each in named]
    shown = str(path.relative_to(folder)) if path.is_relative_to(folder) else str(path)
    in_situ = None if table.in_situ is None else folder / table.in_situ
    return Case(path, name, shown, facts, request, tuple(found), in_situ)


def _file_names(name: str) -> list[str]:
    """FILE of FILE or FILE:VARIABLE."""
    return [each for each in (name, name.rpartition(":")[0]) if each]
