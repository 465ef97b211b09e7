"""What was asked: the data, the liner and every choice by name, with its meaning."""

from __future__ import annotations

import contextlib
import inspect
import re
from collections.abc import Mapping
from typing import Any

import numpy as np

from torchliner.records.summaries import frequency_words, shape_words
from torchliner.report.page.blocks import Block, Facts, Folded, Grid, shown
from torchliner.report.page.subject import MapSubject, base_choices, plain
from torchliner.report.table import Column, Table
from torchliner.velocity.choices import Choices

UNITS = {  # by the ending of a parameter's name
    "thickness": "m", "diameter": "m", "depth": "m", "radius": "m", "pitch": "m", "speed": "m/s",
    "density": "kg/m3", "viscosity": "Pa s",
}  # fmt: skip
MOST_LISTED = 8  # numbers in a cell
FIRST = ("averaging", "phase", "drive", "mean", "interval")
MARKUP = re.compile(r"``|\s+")


def asked(subject: MapSubject) -> list[Block]:
    """Facts of the plane, parameters of the liner, choices."""
    result, choices = subject.result, subject.result.choices
    number = {
        "height": (result.height, "mm", 1e3), "incident level": (result.incident_level, "dB", 1.0),
        "bulk Mach number": (result.mach, "", 1.0),
        "sampling rate": (choices.get("sampling_rate"), "kHz", 1e-3),
        "samples": (choices.get("samples"), "", 1),
    }  # fmt: skip
    named = dict(choices.get("liner") or {})
    facts = [
        ("liner", shown(named.get("name") or named.get("model") or "not stated")),
        ("probes", shape_words(tuple(result.mean_velocity.shape), "probe")),
        ("cells", str(len(result.cell_x))), ("frequency", frequency_words(result.frequency)),
        *((name, f"{scale * value:.6g} {unit}".strip())
          for name, (value, unit, scale) in number.items() if value is not None),
        ("source side", result.source_side),
    ]  # fmt: skip
    liner = liner_table(choices.get("liner"))
    return [
        Facts(facts),
        *_choices(subject),
        *([Folded("The liner's numbers", liner)] if liner else []),
    ]


def liner_table(stated: Any) -> list[Block]:
    """The model's own numbers, those of its gas included."""
    if not isinstance(stated, Mapping) or not stated:
        return []
    flat = {k: v for k, v in stated.items() if not isinstance(v, Mapping) and v is not None}
    flat |= {f"{key}, {k}": v for key, inner in stated.items() if isinstance(inner, Mapping)
             for k, v in inner.items()}  # fmt: skip
    rows = [
        {"parameter": k.replace("_", " "), "value": _words(v),
         "unit": UNITS.get(k.split("_")[-1].split(" ")[-1], "") if isinstance(v, float) else ""}
        for k, v in flat.items()
    ]  # fmt: skip
    columns = [Column(name, heading=name) for name in ("parameter", "value", "unit")]
    caption = f"The liner's model, {shown(stated.get('name') or stated.get('model', ''))}."
    return [Grid("liner-table", caption, Table(rows, columns))]


def _choices(subject: MapSubject) -> list[Block]:
    """Those that matter first and those that are not the default, then all of them, folded."""
    stated, choices = base_choices(subject.result), subject.result.choices
    texts = meanings()
    rows = [
        {"choice": key, "value": _words(choices[key]), "meaning": texts.get(key, ""),
         "from": "stated" if key in stated else "default"}
        for key in Choices().describe() if key in choices
    ]  # fmt: skip
    rows.sort(key=lambda row: (row["from"] == "default", row["choice"]))
    columns = [
        Column("choice", heading="choice"), Column("value", heading="value"),
        Column("from", heading="stated?"), Column("meaning", heading="meaning"),
    ]  # fmt: skip
    first = [row | {"meaning": row["meaning"].split(". ")[0]} for row in rows
             if row["choice"] in FIRST or row["from"] == "stated"]  # fmt: skip
    caption = "What the answer rests on; every choice is below."
    return [
        Grid("main-choices", caption, Table(first, columns)),
        Folded(f"All {len(rows)} choices, with their meaning",
               [Grid("choices", "Every choice behind the map.", Table(rows, columns))]),
    ]  # fmt: skip


def _words(value: Any) -> str:
    value = plain(value)
    if value is None:
        return "none"
    if isinstance(value, float):
        return f"{value:.7g}"
    if isinstance(value, list):
        return _extent(value) or ", ".join(map(_words, value))
    return ("no", "yes")[value] if isinstance(value, bool) else shown(value)


def _extent(values: list[Any]) -> str:
    """Of many numbers, as a table has them; "" for others."""
    numbers = np.zeros(0, str)
    if len(values) > MOST_LISTED:
        with contextlib.suppress(ValueError):  # lists of unlike lengths
            numbers = np.asarray(values)
    if numbers.dtype.kind not in "if" or not numbers.size:
        return ""
    shape = " x ".join(map(str, numbers.shape))
    return f"{shape} values, {numbers.min():.7g} to {numbers.max():.7g}"


def meanings() -> dict[str, str]:
    """What each choice is, from the one place that says it, the docstring of ``Choices``."""
    text = inspect.getdoc(Choices) or ""
    found: dict[str, str] = {}
    for part in re.split(r"\n    (?=\w)", text.partition("Args:")[2]):
        names, colon, words = part.strip().partition(": ")
        if colon:
            plain = MARKUP.sub(lambda m: "" if m[0] == "``" else " ", words).strip()
            found |= dict.fromkeys(names.split(", "), plain)
    return found
