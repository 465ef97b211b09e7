"""How good the default was where the impedance is known: the nearest of the shipped cases."""

from __future__ import annotations

import csv
import functools
import math
from importlib import resources
from typing import Any

import torch

from torchliner.records import ImpedanceMap
from torchliner.studies.rows import Row

TABLE = "reference_cases.csv"  # the default rules of docs/truth.md, by scripts/truth_page.py --write
WORDS = ("case", "hole", "averaging")  # columns of the table that are no numbers
MACH = 0.1  # that counts as much as a factor e in |v|, or as another kind of hole
HEIGHT = 0.1  # weight of a factor e in the height over the hole
NEAR = math.log(2)
SPEEDS = {"speed": "|v| at the tone", "velocity_rms": "v'"}


@functools.cache
def reference_cases() -> tuple[Row, ...]:
    """The shipped table, a row a plane: case, incident_level (dB), reference (Z), educed (Z by averaging), and what
    ``setting_of`` says of a map."""
    text = (resources.files("torchliner.studies") / TABLE).read_text(encoding="utf-8")
    found: dict[tuple[str, str], Row] = {}
    for line in csv.DictReader(text.splitlines()):
        row: Any = Row({key: value if key in WORDS else float(value) for key, value in line.items()})
        reference = complex(row.true_resistance, row.true_reactance)
        plane = found.setdefault((line["case"], line["height"]), Row(row, reference=reference, educed={}))
        plane.educed[row.averaging] = complex(row.resistance, row.reactance)
    return tuple(found.values())


def hole_kind(name: str) -> str:
    """By the name of a liner: the models are of round holes, unless one is called a slit."""
    return "slit" if "slit" in name.lower() else "round hole"


def tone_speed(found: ImpedanceMap, index: int = 0) -> float:
    """rms of the velocity at the tone, m/s: of its mean over the plane, of all probes if it grazes.

    A grazing wave changes its phase along the plane, so that its mean over it says nothing.
    """
    amplitude = found.velocity_amplitude[..., index].reshape(-1)
    amplitude = amplitude[torch.isfinite(amplitude.abs())]
    if found.source_side in ("upstream", "downstream"):
        coherent = found.coherence[..., index].reshape(-1).nan_to_num()[: len(amplitude)]
        return float((amplitude.abs().square() * coherent).mean().sqrt()) / 2**0.5
    return float(amplitude.mean().abs()) / 2**0.5


def setting_of(found: ImpedanceMap, index: int = 0) -> Row | None:
    """What decides how well a rule does; None where the liner of a map states no holes.

    Returns:
        hole (``slit`` or ``round hole``), hole_diameter (m; of a slit its width), porosity (of the surface, 0 to 1),
        mach (None where it is not stated), speed (rms of the velocity in step with the tone, averaged over the plane,
        m/s), velocity_rms (v'_rms over the probes, m/s), height (m).
    """
    liner = found.choices.get("liner", {})
    liner = {**liner, **next(iter(liner.get("layers") or [{}]))}  # the sheet that faces the flow
    if not {"porosity", "orifice_diameter"} <= set(liner):
        return None
    return Row(
        hole=hole_kind(str(liner.get("name", ""))),
        hole_diameter=liner["orifice_diameter"],
        porosity=liner["porosity"] * liner.get("open_area_fraction", 1.0),
        mach=found.mach,
        speed=tone_speed(found, index),
        velocity_rms=float(found.velocity_rms.square().nanmean().sqrt()),
        height=found.height,
    )


def factors_of(here: Row, there: Row) -> list[float]:
    """|v| over porosity here over that there: in step, and of all."""
    share = there.porosity / here.porosity
    return [share * max(here[name], 1e-6) / max(there[name], 1e-6) for name in SPEEDS]


def distance_of(here: Row, there: Row) -> float:
    """0 for the same; 1 for a factor e in |v| over porosity, M 0.1, another kind of hole."""
    far = sum(abs(math.log(factor)) for factor in factors_of(here, there))
    far += abs((here.mach or 0.0) - (there.mach or 0.0)) / MACH + (here.hole != there.hole)
    if here.height and there.height:
        far += HEIGHT * abs(math.log(here.height / here.hole_diameter * there.hole_diameter / there.height))
    return far


def nearest_case(found: ImpedanceMap, index: int = 0) -> str:
    """One line: the shipped case most like this one, what came out there and what it is.

    Args:
        found: a map; of its liner the porosity, of its plane |v|, Mach number and height count.
        index: of the frequency.
    Returns:
        The sentence; "" for a hard wall, a liner without holes, and where no case is near: |v| over porosity within a
        factor of 2, M within 0.05, the same kind of hole.
    """
    here = setting_of(found, index)
    if here is None or found.choices.get("surface") == "hard wall" or not math.isfinite(here.speed + here.velocity_rms):
        return ""
    there = min(reference_cases(), key=lambda each: distance_of(here, each))
    near = all(abs(math.log(factor)) <= NEAR for factor in factors_of(here, there)) and here.hole == there.hole
    if not near or here.mach is None or abs(here.mach - there.mach) > MACH / 2:
        return ""
    parts = []
    for part in ("real", "imag"):
        educed = ", ".join(f"{getattr(z, part):.2f}" for z in there.educed.values())
        parts.append(f"{educed} for {getattr(there.reference, part):.2f}")
    return (
        f"model error seen in the nearest reference case, {there.case} "
        f"({there.speed:.2f} m/s at the tone, v' {there.velocity_rms:.2f} m/s at {1e3 * (there.height or 0):g} mm, "
        f"{100 * there.porosity:.1f} % open, {there.hole}, M {there.mach:g}, {there.incident_level:g} dB) "
        f"R came out {parts[0]}, X {parts[1]} ({', '.join(there.educed)})"
    )
