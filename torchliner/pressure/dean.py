r"""The in situ method: impedance from the pressures on the facesheet and at the cavity bottom.

A plane standing wave fills the cavity of depth H, p = p_b cosh(gamma y'), and all that enters it has passed the
facesheet, so v_in = phi_c u_in, phi_c the share of the surface that is cavity:

.. math:: \rho c\,v_{in} = \varphi_c\sinh(\gamma H)\,p_b, \qquad
          Z = \frac{p_f}{\rho c\,v_{in}} = -j\,\frac{p_f}{p_b}\,\frac{1}{\varphi_c\sin kH} \quad (\text{lossless}).

Two orders of averaging: the admittance over points, v_in <1/p_f>, is the paper's; the plane wave that the surface sends
back knows v_in/<p_f>, exact for normal incidence. The ratio of the two Z is <p_f><1/p_f>.
"""

import math
from collections.abc import Sequence
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import require_choice, tell
from torchliner.conversions import reflection_from_impedance
from torchliner.engine.intervals import FROM_ADMITTANCE, ITSELF
from torchliner.liners.plates import cavity_propagation
from torchliner.names import LOSSES
from torchliner.pressure.spectra import transfer
from torchliner.pressure.tones import Tones
from torchliner.records import Educed, ImpedanceMap, PointImpedances, PressureRecord, VelocityPlane
from torchliner.records.case import require_same_run
from torchliner.records.cells import Cells, sort_into_cells
from torchliner.records.notes import Note
from torchliner.records.origin import origin_of

LOW_COHERENCE = 0.5
NODE = 0.01  # |sinh(gamma H)| below which the velocity at the mouth counts as zero
LARGE_GAIN = 10.0  # relative error of Z per relative error of the sound speed or the depth
ORDERS = ("admittance", "pressure-first")  # of averaging


def in_situ(record: PressureRecord, frequency: Any = None, *, losses: str = "none", **cut: Any) -> PointImpedances:
    """Impedance at every facesheet point, per cell and over the whole surface, after Dean.

    Args:
        record: facesheet and backplate pressure, cavity depth and porosity.
        frequency: Hz, one or several; default the record's own tone.
        losses: of the wave in the cavity, ``none`` or ``viscothermal`` (needs the cavity's hydraulic radius).
        cut: ``window``, ``segment``, ``start``, ``allow_short`` and ``interval``, as of ``pressure.tones.Tones``.
    Returns:
        Impedances in both orders of averaging (see the module), with the coherence of the two pressures and intervals,
        both over blocks of whole periods, or segments.
    Raises:
        ValueError: a pressure is missing or has no tone; the record is too short; a frequency is at or above Nyquist,
            or sin(kH) is zero there, by which Dean's formula divides.
    Warns:
        DataWarning: the answer is doubtful; the same text is in ``notes``.
    Source: Dean, J. Sound Vib. 34 (1974) 97, with the cavity porosity and, as an option, the losses of eq. (2.2d) of
        Roncen et al. (2026); H1 with the backplate as input, since the turbulence on the facesheet is then the output's
        noise and leaves no bias.
    """
    tones = Tones(record, frequency, **cut)
    require_choice("losses", losses, LOSSES)
    if record.facesheet is None or record.cavity_depth is None:
        raise ValueError(f"{record.name}: the in situ method needs facesheet pressure and cavity_depth")
    ratio, notes = mouth_velocity_ratio(record, tones.frequency, losses)
    cells, rows = _cells_of(record)
    used = rows >= 0
    inside = ((cells.labels >= 0) & used)[:, None]
    made, points, coherences = [], [], []
    for gain, hertz in zip(ratio, tones.frequency[:, None], strict=True):
        parts, bottom = (
            tones.parts(label, getattr(record, label).reshape(-1, record.samples), hertz)
            for label in ("facesheet", "backplate")
        )
        face, velocity = parts.amplitudes, gain * bottom.amplitudes[:, rows.clamp(min=0)]
        z = parts.h1(velocity, face)
        points.append(torch.where(used[:, None], z[0], torch.nan))
        size = parts.weights.sqrt()[:, None, None]
        coherences.append(torch.where(used[:, None], transfer(size * velocity, size * face)[1], 0.0))
        admittance = cells.average(torch.where(inside, 1 / z, 0), used)
        face, velocity = cells.average(face, used), cells.average(velocity, used)
        # Over whole cells in both orders, so that their ratio is <p_f><1/p_f>.
        ways = {
            "cells admittance": (admittance, FROM_ADMITTANCE),
            "liner admittance": (admittance.mean(-2), FROM_ADMITTANCE),
            "cells pressure-first": (parts.h1(velocity, face), ITSELF),
            "liner pressure-first": (parts.h1(velocity.mean(-2), face.mean(-2)), ITSELF),
        }
        made.append((parts, ways))
    found, blocks = tones.results(made)
    coherence = cells.average(torch.cat(coherences, -1), used)
    notes += _notes(record, float(tones.frequency.max()), coherence, blocks)
    notes += tones.few_blocks_notes("in situ", found["liner admittance"])
    tell([str(note) for note in notes])
    unknown = torch.full((record.probes,), torch.nan, dtype=torch.float64)
    x, z = (unknown if values is None else values for values in record.probe_coordinates())
    choices = {"method": "in situ", "losses": losses, **tones.choices, "source": record.name}
    choices |= {key: getattr(record, key) for key in ("cavity_depth", "cavity_porosity")}
    choices |= {"interval": tones.interval, "blocks": blocks, **origin_of([("in situ", record.name)])}
    return PointImpedances(
        name="in situ (Dean)",
        frequency=tones.frequency,
        cell_x=cells.x,
        cell_z=cells.z,
        coherence=coherence,
        point_x=x,
        point_z=z,
        points=Educed(reflection_from_impedance(torch.cat(points, -1))),
        cells={name: found[f"cells {name}"] for name in ORDERS},
        liner={name: found[f"liner {name}"] for name in ORDERS},
        choices=choices,
        notes=tuple(notes),
    )


def with_in_situ(
    maps: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane], record: PressureRecord
) -> list[ImpedanceMap]:
    """Maps, one a plane, with the in situ impedances of a record of the same case beside them."""
    for plane in planes:
        require_same_run(plane, record)
    return [one.with_alongside(in_situ(record, one.frequency, interval=one.level)) for one in maps]


def mouth_velocity_ratio(record: PressureRecord, frequency: Tensor, losses: str = "none") -> tuple[Tensor, list[Note]]:
    """rho c v_in/p_b = phi_c sinh(gamma H) at the frequencies, (F,), and warnings; ValueError where the mouth is a
    velocity node, or for losses without a hydraulic radius."""
    assert record.cavity_depth is not None
    omega = 2 * torch.pi * frequency.to(torch.float64)
    gamma = 1j * omega / record.fluid.sound_speed
    if losses == "viscothermal":
        if record.cavity_hydraulic_radius is None:
            raise ValueError(f"{record.name}: cavity_hydraulic_radius (m) is missing; losses='viscothermal' needs it")
        gamma = cavity_propagation(omega, record.cavity_hydraulic_radius, record.fluid)
    ratio, turns = torch.sinh(gamma * record.cavity_depth), gamma.imag * record.cavity_depth / torch.pi
    notes = []
    for f, value, turn in zip(frequency.tolist(), ratio.tolist(), turns.tolist(), strict=True):
        order = round(turn)
        node = f"a velocity node of the cavity's mouth, {f * max(order, 1) / turn:.6g} Hz"
        if order and abs(value) < NODE:
            divisor = f"sin(kH), by which Dean's formula divides, is {abs(value):.2g} at {f:g} Hz"
            raise ValueError(f"{record.name}: {divisor}, near {node}; take a frequency further off")
        gain = abs(math.pi * turn / math.tan(math.pi * turn))
        if gain > LARGE_GAIN:
            text = f"{f:g} Hz lies near {node}; 1 % in depth or sound speed is {gain:.3g} % in Z"
            notes.append(Note("mouth-node", f"{record.name}: {text}"))
    return record.cavity_porosity * ratio, notes


def _cells_of(record: PressureRecord) -> tuple[Cells, Tensor]:
    """The cells, and which row of the backplate belongs to each probe, (P,), -1 for none."""
    cells, rows = sort_into_cells(record, record.cell_pitch), math.prod(record.backplate.shape[:-1])
    row_of = {record.probes: torch.arange(record.probes), cells.count: cells.labels, 1: torch.zeros_like(cells.labels)}
    if rows not in row_of:
        there = f"{cells.count} cells (cell_pitch), {record.probes} facesheet probes"
        raise ValueError(f"{record.name}: backplate has {rows} rows, for {there}; give one for all, or one for each")
    return cells, row_of[rows]


def _notes(record: PressureRecord, highest: float, coherence: Tensor, blocks: int) -> list[Note]:
    """Pressures that do not belong together; above c/(2 pitch) a cavity that carries more than the plane wave."""
    notes, low = [], coherence < LOW_COHERENCE
    if bool(low.any()):
        text = f"the coherence of facesheet and backplate pressure is {float(coherence[low].min()):.2g} at worst, below"
        count = f"{int(low.sum())} of {low.numel()} values ({blocks} blocks): turbulence, no sound"
        notes.append(Note("low-coherence", f"{record.name}: {text} {LOW_COHERENCE:g} in {count}"))
    if record.cell_pitch and highest >= (limit := record.fluid.sound_speed / (2 * record.cell_pitch)):
        wide = f"a cavity as wide as its cell, {1e3 * record.cell_pitch:g} mm, carries transverse waves"
        text = f"above {limit:.4g} Hz {wide}; Dean's formula assumes the plane one alone"
        notes.append(Note("cavity-modes", f"{record.name}: {text}"))
    return notes
