r"""Velocity into a liner's surface from the pressure at the bottom of its cavities.

With y' measured from the backplate, a plane standing wave fills the cavity, p = p_b cosh(gamma y'), gamma = j omega/c
without losses. Its velocity towards the cavity's mouth follows from momentum, rho c u = -p_b sinh(gamma y'), hence into
the cavity at the mouth, y' = H, rho c u_in = p_b sinh(gamma H) (lossless: j p_b sin kH). All that enters the cavity has
passed the facesheet above it, whose thickness is short against the wavelength: v_in = phi_c u_in over the whole
surface, phi_c being the share of the surface that is cavity. So

.. math:: \rho c\,v_{in} = \varphi_c\sinh(\gamma H)\,p_b \;=\; j\,\varphi_c\sin(kH)\,p_b
            \quad (\text{lossless}).
"""

from __future__ import annotations

import math

import torch
from torch import Tensor

from torchliner.liners.cavity import cavity_propagation
from torchliner.records import PressureRecord
from torchliner.records.notes import Note

NODE = 0.01  # |sinh(gamma H)| below which the velocity at the mouth counts as zero
LARGE_GAIN = 10.0  # relative error of Z per relative error of the sound speed or the depth


def mouth_velocity_ratio(record: PressureRecord, frequency: Tensor, losses: str = "none") -> tuple[Tensor, list[Note]]:
    """rho c v_in/p_b = phi_c sinh(gamma H) at the frequencies, (F,), and warnings.

    Raises:
        ValueError: it is zero at a frequency: the mouth is a velocity node; losses without a hydraulic radius.
    """
    assert record.cavity_depth is not None
    omega = 2 * torch.pi * frequency.to(torch.float64)
    gamma = 1j * omega / record.fluid.sound_speed
    if losses == "viscothermal":
        if record.cavity_hydraulic_radius is None:
            raise ValueError(
                f"{record.name}: cavity_hydraulic_radius is missing; losses='viscothermal' needs it (m; half the side "
                "of a square cavity)"
            )
        radius = torch.tensor(record.cavity_hydraulic_radius, dtype=torch.float64)
        gamma = cavity_propagation(omega, radius, record.fluid)
    ratio, turns = torch.sinh(gamma * record.cavity_depth), gamma.imag * record.cavity_depth / torch.pi
    notes = []
    for f, value, turn in zip(frequency.tolist(), ratio.tolist(), turns.tolist(), strict=True):
        order = round(turn)
        node = f"a velocity node of the cavity's mouth, {f * max(order, 1) / turn:.6g} Hz"
        if order and abs(value) < NODE:
            raise ValueError(
                f"{record.name}: sin(kH) is {abs(value):.2g} at {f:g} Hz: there is, with a cavity of "
                f"{1e3 * record.cavity_depth:g} mm {node} (n c/(2H), n = {order}), and Dean's formula divides by "
                "sin(kH); take a frequency further off"
            )
        gain = abs(math.pi * turn / math.tan(math.pi * turn))
        if gain > LARGE_GAIN:
            text = f"{f:g} Hz lies near {node}; 1 % in depth or sound speed is {gain:.3g} % in Z"
            notes.append(Note("mouth-node", f"{record.name}: {text}"))
    return record.cavity_porosity * ratio, notes
