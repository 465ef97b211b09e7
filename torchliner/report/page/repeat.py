"""What gives a map again: the command that made it, and a program in Python."""

from __future__ import annotations

import shlex
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from torchliner.liners.catalogue import load_liner, preset_names
from torchliner.records import ImpedanceMap
from torchliner.report.page.blocks import Block, Code, Text
from torchliner.report.page.subject import MapSubject, base_choices, inputs_of, plain

EDUCED = ("incident_level", "source_side")  # facts that ``torchliner educe`` takes
LINE = "The command line"
ONE_PHASE = f"{LINE} takes one reference phase; the map has one a probe."
JOINS = f"{LINE} joins files by one quoted pattern; these are read as planes of their own."
UNTOLD = "What a program changed of the plane before it was educed is not held."


def source_of(result: ImpedanceMap) -> Path | None:
    """The file that a map says it was educed from."""
    name = str(result.choices.get("source", "")).split(":/")[0]
    return Path(name) if name else None


def preset_of(result: ImpedanceMap) -> str:
    """The preset with the numbers of the map's liner; "" where there is none."""
    stated = plain(dict(result.choices.get("liner") or {}))
    name = str(stated.get("name", ""))
    same = name in preset_names() and plain(load_liner(name).describe()) == stated
    return name if same else ""


def command(subject: MapSubject) -> list[Block]:
    """The command as it was typed, else one that follows from the choices; and Python."""
    result, typed = subject.result, subject.result.choices.get("command")
    if source_of(result) is None:
        return [Text("The map does not say which file it was educed from.")]
    if result.choices.get("incident") is not None:
        if isinstance(typed, list):
            return [Text("The command as it was typed."), Code("command", shlex.join(["torchliner", *map(str, typed)]))]
        return [Text("The map is of a replayed wave; what gives it again is tl.replay with the choices above.")]
    known = Repeated(subject)
    if isinstance(typed, list):
        words = ["torchliner", *map(str, typed)]
        text = "The command as it was typed, and Python that gives the same impedances."
    else:
        words, lost = known.words(), known.lost()
        text = f"The map again, from its own record of its choices. {lost}"
    return [
        Text(text.strip()), Code("command", " ".join(map(shlex.quote, words))),
        Code("Python", known.program()),
    ]  # fmt: skip


class Repeated:
    """What a map holds of its own making.

    Args:
        subject: the map, and its file.
    """

    def __init__(self, subject: MapSubject) -> None:
        result = subject.result
        self.result, self.path = result, str(subject.path or "map.h5")
        inputs = inputs_of(result)
        self.held = bool(inputs)
        self.files = {what: [str(each["name"]) for each in inputs if each["what"] == what]
                      for what in dict.fromkeys(each["what"] for each in inputs)}  # fmt: skip
        self.chosen = base_choices(result)
        data = plain(dict(result.choices.get("data") or {}))
        self.moments = "moments" in self.files
        self.read = {} if self.moments else _table(data, "stated") | _table(data, "selected")
        self.restated = _table(data, "restated")
        self.frequencies = [float(f) for f in result.frequency.tolist()]
        self.phase = result.choices.get("reference_phase")
        self.rebuilt, self.preset = subject.model is not None, preset_of(result)
        beside = [str(o.choices["source"]) for o in result.alongside if "source" in o.choices]
        self.beside = beside[0] if beside else ""
        walls = self.files.get("wall pressure", [])
        self.wall = walls[0] if walls else self.beside

    @property
    def data(self) -> list[str]:
        """Files of the plane, or of its moments."""
        named = self.files.get("moments") or self.files.get("velocity")
        return named or [str(source_of(self.result))]

    def words(self) -> list[str]:
        """On the command line."""
        liner = self.preset or next(iter(self.files.get("liner", [])), "LINER.toml")
        found = ["torchliner", "educe", *self.data, "--liner", liner]
        found += ["--frequency", *map(_number, self.frequencies)]
        for key, value in self.chosen.items():
            found += _option(key, value)
        facts = {key: fact for key, fact in self.restated.items() if key in EDUCED}
        for key, value in (self.read | facts).items():
            found += _option(key, _typed(key, value))
        found += ["--reference-phase", repr(self.phase)] if isinstance(self.phase, float) else []
        found += ["--in-situ", self.beside] if self.beside else []
        found += ["--wall-pressure", self.wall] if self.wall != self.beside else []
        return [*found, "-o", self.path]

    def program(self) -> str:
        """In Python."""
        own = f"tl.read_map({self.path!r}).choices"
        name = self.data[0] if len(self.data) == 1 else self.data
        said = "".join(f", {key}={key.upper() if value is None else repr(value)}"
                       for key, value in self.read.items())  # fmt: skip
        lines = ["import torchliner as tl", "", f"plane = tl.read_plane({name!r}, lazy=True{said})"]
        if self.moments:
            lines[-1] = f"moments = tl.read_moments({name!r})"
        data = "moments" if self.moments else "plane"
        if self.restated:
            facts = "".join(f", {key}={value!r}" for key, value in self.restated.items())
            if self.moments:
                facts = f", plane=dataclasses.replace(moments.plane{facts})"
            lines = [
                "import dataclasses",
                "",
                *lines,
                f"{data} = dataclasses.replace({data}{facts})",
            ]
        liner = repr(self.preset) if self.preset else f'{own}["liner"]'
        if not self.rebuilt:
            liner = repr(next(iter(self.files.get("liner", [])), "LINER.toml"))
        arguments = [data, f"tl.load_liner({liner})", repr(self.frequencies)]
        arguments += [f"{key}={value!r}" for key, value in self.chosen.items()]
        if self.phase is not None:
            one = isinstance(self.phase, float)
            phase = repr(self.phase) if one else f'{own}["reference_phase"]'
            arguments.append(f"reference_phase={phase}")
        if self.wall:
            check = self.result.level_check
            line = check is not None and check.known.startswith("microphones along")
            reader = "read_microphones" if line else "read_pressure"
            arguments.append(f"pressure=tl.{reader}({self.wall!r})")
        body = ",\n    ".join(arguments)
        return "\n".join([*lines, f"found = tl.educe(\n    {body},\n)"])

    def lost(self) -> str:
        """What the map does not hold of its making, or the command line cannot say."""
        found, choices = [], self.result.choices
        if not self.preset and "liner" not in self.files:
            found.append("the file of the liner, LINER.toml, whose numbers are listed above")
        if choices.get("phase") == "given" and self.phase is None:
            found.append("the reference phase")
        check = self.result.level_check
        if check is not None and check.kind == "wall" and not (self.held or self.wall):
            found.append("the file of the wall pressures (--wall-pressure)")
        found += [f"{key} as it was stated" for key, value in self.read.items() if value is None]
        words = [f"The map does not hold {', '.join(found)}."] if found else []
        words += [ONE_PHASE] if isinstance(self.phase, list) else []
        words += [JOINS] if len(self.data) > 1 else []
        facts = [f"{key} = {fact}" for key, fact in self.restated.items() if key not in EDUCED]
        words += [f"{LINE} cannot state {', '.join(facts)}, as was done."] if facts else []
        return " ".join([*words, UNTOLD])


def _table(data: Mapping[str, Any], key: str) -> dict[str, Any]:
    """A file may hold anything of that name."""
    found = data.get(key)
    return dict(found) if isinstance(found, Mapping) else {}


def _typed(key: str, value: Any) -> Any:
    """As the command line has it."""
    if value is None:
        return key.upper()
    if key == "axes":
        return ",".join(map(str, value))
    if key == "region" and not isinstance(value, str):
        sides = [["" if side is None else _number(side) for side in limits] for limits in value]
        return ",".join(":".join(limits) for limits in sides)
    return value


def _option(key: str, value: Any) -> list[str]:
    """Of the command line."""
    if key == "interval" and value is None:
        return ["--no-intervals"]
    flag = f"--{key.replace('_', '-')}"
    if value is True:
        return [flag]
    if isinstance(value, str) and value.startswith("-"):
        return [f"{flag}={value}"]
    values = value if isinstance(value, (list, tuple)) else [value]
    return [flag, *(_number(v) if isinstance(v, float) else str(v) for v in values)]


def _number(value: float) -> str:
    """In few digits where these are the number itself."""
    short = f"{value:.12g}"
    return short if float(short) == value else repr(value)
