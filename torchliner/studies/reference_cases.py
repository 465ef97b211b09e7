"""How good the default was where the impedance is known: the nearest of the shipped cases."""

from __future__ import annotations

import csv
import functools
import math
from dataclasses import dataclass
from importlib import resources

import torch

from torchliner.records import ImpedanceMap

TABLE = "reference_cases.csv"  # the default rules of docs/truth.md, by scripts/truth_page.py --write
WORDS = ("case", "hole", "averaging")  # columns of the table that are no numbers
MACH = 0.1  # that counts as much as a factor e in |v|, or as another kind of hole
HEIGHT = 0.1  # weight of a factor e in the height over the hole
NEAR = math.log(2)


@dataclass(frozen=True)
class Setting:
    """What decides how well a rule does.

    Args:
        hole: ``slit`` or ``round hole``.
        diameter: of the hole (width of the slit), m.
        porosity: of the surface, 0 to 1.
        mach: None where it is not stated.
        speed: rms of the velocity in step with the tone, averaged over the plane, m/s.
        velocity_rms: v'_rms over the probes, m/s.
        height: m.
    """

    hole: str
    diameter: float
    porosity: float
    mach: float | None
    speed: float
    velocity_rms: float
    height: float | None

    def factors(self, known: Setting) -> tuple[float, float]:
        """|v| over porosity here over that there: in step, and of all."""
        share = known.porosity / self.porosity
        pairs = ((self.speed, known.speed), (self.velocity_rms, known.velocity_rms))
        first, second = (share * max(here, 1e-6) / max(there, 1e-6) for here, there in pairs)
        return first, second

    def distance(self, known: Setting) -> float:
        """0 for the same; 1 for a factor e in |v| over porosity, M 0.1, another kind of hole."""
        far = sum(abs(math.log(factor)) for factor in self.factors(known))
        far += abs((self.mach or 0.0) - (known.mach or 0.0)) / MACH + (self.hole != known.hole)
        if self.height and known.height:
            ratio = self.height / self.diameter * known.diameter / known.height
            far += HEIGHT * abs(math.log(ratio))
        return far


@dataclass(frozen=True)
class ReferenceCase:
    """One plane of a shipped case: its reference impedance, and what the default rules gave, by averaging."""

    case: str
    level: float
    setting: Setting
    reference: complex
    educed: dict[str, complex]


@functools.cache
def reference_cases() -> tuple[ReferenceCase, ...]:
    """The shipped table, a plane each."""
    text = (resources.files("torchliner.studies") / TABLE).read_text(encoding="utf-8")
    found: dict[tuple[str, str], ReferenceCase] = {}
    for row in csv.DictReader(text.splitlines()):
        number = {key: float(value) for key, value in row.items() if key not in WORDS}
        names = ("hole_diameter", "porosity", "mach", "speed", "velocity_rms", "height")
        setting = Setting(row["hole"], *(number[name] for name in names))
        reference = complex(number["true_resistance"], number["true_reactance"])
        new = ReferenceCase(row["case"], number["incident_level"], setting, reference, {})
        plane = found.setdefault((row["case"], row["height"]), new)
        plane.educed[row["averaging"]] = complex(number["resistance"], number["reactance"])
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


def setting_of(found: ImpedanceMap, index: int = 0) -> Setting | None:
    """Of a map; None where its liner states no holes."""
    liner = found.choices.get("liner", {})
    liner = {**liner, **next(iter(liner.get("layers") or [{}]))}  # the sheet that faces the flow
    if not {"porosity", "orifice_diameter"} <= set(liner):
        return None
    return Setting(
        hole=hole_kind(str(liner.get("name", ""))),
        diameter=liner["orifice_diameter"],
        porosity=liner["porosity"] * liner.get("open_area_fraction", 1.0),
        mach=found.mach,
        speed=tone_speed(found, index),
        velocity_rms=float(found.velocity_rms.square().nanmean().sqrt()),
        height=found.height,
    )


def nearest_case(found: ImpedanceMap, index: int = 0) -> str:
    """One line: the shipped case most like this one, what came out there and what it is.

    Args:
        found: a map; of its liner the porosity, of its plane |v|, Mach number and height count.
        index: of the frequency.
    Returns:
        The sentence; "" for a hard wall or a liner without holes.
    """
    here = setting_of(found, index)
    if here is None or found.choices.get("surface") == "hard wall" or not math.isfinite(here.speed + here.velocity_rms):
        return ""
    known = min(reference_cases(), key=lambda each: here.distance(each.setting))
    there = known.setting
    parts = []
    for part in ("real", "imag"):
        educed = ", ".join(f"{getattr(z, part):.2f}" for z in known.educed.values())
        parts.append(f"{educed} for {getattr(known.reference, part):.2f}")
    return (
        f"nearest reference case{_differences(here, there)}: in {known.case} ({there.speed:.2f} m/s at the "
        f"tone, v' {there.velocity_rms:.2f} m/s at {1e3 * (there.height or 0):g} mm, "
        f"{100 * there.porosity:.1f} % open, {there.hole}, M {there.mach:g}, {known.level:g} dB) "
        f"R came out {parts[0]}, X {parts[1]} ({', '.join(known.educed)})"
    )


def _differences(here: Setting, there: Setting) -> str:
    """' (not near: ...)' where it differs by a factor 2, by M 0.1 or in its holes."""
    names = ("|v| at the tone", "v'")
    off = [
        f"{name} over porosity is {factor:.2g} times that"
        for name, factor in zip(names, here.factors(there), strict=True)
        if abs(math.log(factor)) > NEAR
    ]
    if here.mach is None:
        off.append("Mach number not stated")
    elif abs(here.mach - (there.mach or 0.0)) > MACH / 2:
        off.append(f"M {here.mach:g}")
    if here.hole != there.hole:
        off.append(f"{here.hole}s")
    return f" (not near; here {', '.join(off)})" if off else ""
