"""What is known of the height of a plane besides its averaging lengths: modulation, level check, reach of the jets."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import torch
from torch import Tensor

from torchliner.checks import DataWarning, plain_number
from torchliner.duct.flow_profiles import Array, TanhProfile
from torchliner.liners.model import LinerModel
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.studies.jets import jet_velocity, penetration_height
from torchliner.studies.modulation import Modulation, cell_modulation
from torchliner.velocity.reading import time_moments


@dataclass(frozen=True)
class JetFlow:
    """The mean flow that the jets of appendix A.2 stand in; the paper's values of figure 22.

    Args:
        duct_height: H, m.
        shear: of ``TanhProfile``.
    Raises:
        ValueError: see ``TanhProfile``.
    """

    duct_height: float = 50e-3
    shear: float = 0.05

    def __post_init__(self) -> None:
        self.profile(0.1, 343.2)

    def profile(self, mach: float, sound_speed: float) -> TanhProfile:
        """The profile at a bulk Mach number."""
        return TanhProfile(mach, self.duct_height, self.shear, sound_speed)


@dataclass(frozen=True)
class HeightFacts:
    """One plane: what does not hang on the averaging length.

    Args:
        height: m.
        coherence: squared, of v with the tone, median over probes.
        velocity_rms: v', m/s, over the plane.
        modulation, mean_modulation, streamwise_modulation: of v'_rms, v_0 and u'_rms along x; None without a whole cell
            (or without u).
        jet_velocity, jet_height: m/s and m, eqs (A3) and (A2), with |Z| in the averaging of the answer; None where
            something is unknown.
        impedance: Z of the whole plane by averaging.
        level_check: level of the incident wave that Z and velocity imply over the one that is known, dB, by averaging;
            empty where it was not checked.
        level_limit: dB.
    """

    height: float
    coherence: float
    velocity_rms: float
    modulation: Modulation | None
    mean_modulation: Modulation | None
    streamwise_modulation: Modulation | None
    jet_velocity: float | None
    jet_height: float | None
    impedance: Mapping[str, complex]
    level_check: Mapping[str, float]
    level_limit: float


def facts_of_plane(
    plane: VelocityPlane, seen: ImpedanceMap, liner: LinerModel, pitch: float | None, flow: JetFlow
) -> tuple[HeightFacts, list[str]]:
    """The facts of a plane, and what could not be found out and why.

    Args:
        plane: with coordinates and a height.
        seen: its map, at one frequency.
        liner: whose ``surface_porosity`` and ``hole_diameter`` are used, if it has holes.
        pitch: L_c, m, or None.
        flow: for the jets.
    """
    rms, check = seen.velocity_rms.detach().cpu(), seen.level_check
    (waves, steady, stream), notes = _modulations(plane, rms, seen.mean_velocity.detach().cpu(), pitch)
    speed, reach, reason = _jet(plane, complex(seen.answer[0]), liner, flow)
    levels = {} if check is None else dict(zip(check.averagings, check.liner.level[:, 0].tolist(), strict=True))
    facts = HeightFacts(
        height=plane.height or 0.0,
        coherence=float(seen.coherence[..., 0].nanmedian()),
        velocity_rms=float((rms**2).nanmean().sqrt()),
        modulation=waves,
        mean_modulation=steady,
        streamwise_modulation=stream,
        jet_velocity=speed,
        jet_height=reach,
        impedance={name: complex(each.impedance[0]) for name, each in seen.liner.items()},
        level_check={name: level for name, level in levels.items() if math.isfinite(level)},
        level_limit=math.nan if check is None else check.limit,
    )
    return facts, notes if reason is None else [*notes, f"no jet height: {reason}"]


def _modulations(
    plane: VelocityPlane, rms: Tensor, mean: Tensor, pitch: float | None
) -> tuple[list[Modulation | None], list[str]]:
    nothing: list[Modulation | None] = [None, None, None]
    if pitch is None:
        return nothing, ["no cell pitch is known; the cell-periodic modulation cannot be judged"]
    profiles: list[Array | None] = [_over_z(rms**2) ** 0.5, _over_z(mean), None]
    if plane.streamwise is not None:
        name = f"{plane.name}, streamwise"
        stream = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate, name=name)
        mean_stream, square = time_moments(stream)
        variance = (square - mean_stream**2).clamp(min=0)
        profiles[2] = _over_z(variance.reshape(plane.probe_shape)) ** 0.5
    try:
        found = [None if each is None else cell_modulation(plane.x, each, pitch) for each in profiles]
    except ValueError as error:
        return nothing, [f"{plane.name}: no cell-periodic modulation can be judged: {error}"]
    note = (
        "the probes span a single cell: the cell-periodic modulation is the harmonics of the pitch in it, and nothing "
        "shows that they repeat"
    )
    return found, [note] if found[0] is not None and found[0].cells == 1 else []


def _over_z(values: Tensor) -> Array:
    """Mean over z of (z, x); (x) as it is."""
    return values.reshape(-1, values.shape[-1]).nanmean(0).to(torch.float64).numpy()


def _jet(
    plane: VelocityPlane, impedance: complex, liner: LinerModel, flow: JetFlow
) -> tuple[float | None, float | None, str | None]:
    """U_j, H_j, and why one of them is not known."""
    if plane.liner == "hard wall":
        return None, None, "there are no holes in a hard wall"
    level, mach = plane.incident_level, plane.mach
    porosity, diameter = liner.surface_porosity, liner.hole_diameter
    if level is None or mach is None or porosity is None or diameter is None:
        names = ("level of the sound", "Mach number", "porosity", "hole diameter")
        values = (level, mach, porosity, diameter)
        lacking = [name for name, value in zip(names, values, strict=True) if value is None]
        return None, None, f"{' and '.join(lacking)} not stated"
    if not 0 < abs(impedance) < math.inf:
        return None, None, f"the impedance is {impedance}"
    speed = jet_velocity(level, plain_number(porosity), impedance, plane.fluid)
    if not mach:
        return speed, None, "without a mean flow A.2 sets no limit to a jet"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # of a thin shear layer: JetFlow has warned
        profile = flow.profile(mach, float(plane.fluid.sound_speed))
    try:
        return speed, float(penetration_height(speed, diameter, profile)), None
    except ValueError as error:
        return speed, None, str(error)
