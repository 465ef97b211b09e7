"""What is known of one plane's height besides its impedance: imprint of the cells, jets' reach."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from torchliner.checks import DataWarning, plain_number
from torchliner.flow_profiles import TanhProfile
from torchliner.heights.imprint import Imprint, cell_imprint
from torchliner.heights.jets import jet_velocity, penetration_height
from torchliner.liners.model import LinerModel
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.reduction.survey import moments


@dataclass(frozen=True)
class JetFlow:
    """The mean flow that the jets of appendix A.2 stand in; the paper's values of figure 22.

    Args:
        duct_height: H, m.  shear: of ``TanhProfile``.
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
        height: m.  coherence: squared, of v with the tone, median over probes.
        velocity_rms: v', m/s, over the plane.
        imprint, mean_imprint, streamwise_imprint: of v'_rms, v_0 and u'_rms along x; None without
            a whole cell (or without u).
        jet_velocity, jet_height: m/s and m, eqs (A3) and (A2); None where something is unknown.
        impedance: Z of the whole plane by order of averaging.
        closure: level of the incident wave that Z and velocity imply over the one that is known,
            dB, by order; empty where it was not checked.
        closure_limit: dB.
    """

    height: float
    coherence: float
    velocity_rms: float
    imprint: Imprint | None
    mean_imprint: Imprint | None
    streamwise_imprint: Imprint | None
    jet_velocity: float | None
    jet_height: float | None
    impedance: Mapping[str, complex]
    closure: Mapping[str, float]
    closure_limit: float


def facts_of_plane(
    plane: VelocityPlane, seen: ImpedanceMap, liner: LinerModel, pitch: float | None, flow: JetFlow
) -> tuple[HeightFacts, list[str]]:
    """The facts of a plane, and what could not be found out and why.

    Args:
        plane: with coordinates and a height.  seen: its map, at one frequency.
        liner: whose ``surface_porosity`` and ``hole_diameter`` are used, if it has holes.
        pitch: L_c, m, or None.  flow: for the jets.
    """
    assert plane.height is not None
    rms = seen.velocity_rms.detach().cpu()
    (waves, steady, stream), notes = _imprints(plane, rms, seen.mean_velocity.detach().cpu(), pitch)
    speed, reach, reason = _jet(plane, complex(seen.liner_impedance[0]), liner, flow)
    facts = HeightFacts(
        plane.height, float(seen.coherence[..., 0].nanmedian()),
        float((rms**2).nanmean().sqrt()), waves, steady, stream, speed, reach,
        {order: complex(seen.of_liner(order)[0]) for order in seen.orders}, *_closure(seen),
    )  # fmt: skip
    return facts, notes if reason is None else [*notes, f"no jet height: {reason}"]


def _closure(seen: ImpedanceMap) -> tuple[dict[str, float], float]:
    """dB by order, and the limit."""
    closure = getattr(seen, "closure", None)
    if closure is None:
        return {}, math.nan
    levels = dict(zip(closure.orders, closure.liner.level[:, 0].tolist(), strict=True))
    return {order: level for order, level in levels.items() if math.isfinite(level)}, closure.limit


def _imprints(
    plane: VelocityPlane, rms: Tensor, mean: Tensor, pitch: float | None
) -> tuple[list[Imprint | None], list[str]]:
    if pitch is None:
        return [None, None, None], ["no cell pitch is known; the cells' imprint cannot be judged"]
    profiles: list[NDArray[np.float64] | None] = [_over_z(rms**2) ** 0.5, _over_z(mean), None]
    if plane.streamwise is not None:
        name = f"{plane.name}, streamwise"
        stream = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate, name=name)
        first, square = moments(stream)
        variance = (square - first**2).clamp(min=0).reshape(plane.probe_shape)
        profiles[2] = _over_z(variance) ** 0.5
    try:
        found = [None if p is None else cell_imprint(plane.x, p, pitch) for p in profiles]
    except ValueError as error:
        return [None, None, None], [f"{plane.name}: no imprint can be judged: {error}"]
    alone = found[0] is not None and found[0].cells == 1
    note = ("the probes span a single cell: the imprint is the harmonics of the pitch in it, and "
            "nothing shows that they repeat")  # fmt: skip
    return found, [note] if alone else []


def _over_z(values: Tensor) -> NDArray[np.float64]:
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
    stated = {"level of the sound": level, "Mach number": mach, "porosity": porosity,
              "hole diameter": diameter}  # fmt: skip
    if level is None or mach is None or porosity is None or diameter is None:
        lacking = [name for name, value in stated.items() if value is None]
        return None, None, f"{' and '.join(lacking)} not stated"
    if not 0 < abs(impedance) < float("inf"):
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
