"""Warnings about the data, with numbers: refusals raise, the rest is returned as notes."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.checks import FEWEST_PERIODS
from torchliner.fluid import gas_warnings
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.cells import Cells
from torchliner.records.unit_checks import height_warnings, plane_unit_warnings
from torchliner.reduction.periodic import FEWEST_BLOCKS, PeriodicPart
from torchliner.reduction.survey import Survey
from torchliner.replay.edges import Record
from torchliner.replay.kernels import AFTER, BEFORE
from torchliner.tdibc.choices import Choices

FEWEST_WEIGHTS = 2  # samples under the window that count
WHOLE_PERIOD_TOLERANCE = 1e-6
FEWEST_SAMPLES_PER_PERIOD = 8.0
SAME_MACH = 0.01
EVEN = 1.01  # largest over smallest area of probes that count alike
LONG_CELL = 0.125  # wavelengths: over a cell as long the tone turns by 45 degrees


def needs_kernels(chosen: Choices) -> bool:
    """Whether impulse responses enter at all."""
    return chosen.engine != "spectral" or chosen.uses_kernel_response


def review_record(plane: VelocityPlane, frequency: Tensor, record: Record, chosen: Choices) -> list[str]:
    """Length and rate against the frequencies."""
    notes = []
    if plane.liner == "hard wall":
        notes.append(
            f"null test: there is a hard wall below {plane.name} and no liner; the values only "
            "show what this model makes of such a velocity"
        )
    weighing = int(record.window.weights.count_nonzero())
    if weighing < FEWEST_WEIGHTS:
        raise ValueError(
            f"{plane.name}: of {record.samples - record.start} samples {weighing} weigh anything "
            f"under window {record.window.name!r}; a mean needs {FEWEST_WEIGHTS} or more, take a "
            "longer record"
        )
    seconds = (record.samples - record.start) / record.sampling_rate
    wave = chosen.incident
    # Over segments of a periodic signal the lines asked for need not be the record's.
    on_lines = wave is None or chosen.segment is None
    tones = [] if wave is None else getattr(wave, "frequency", torch.zeros(0)).tolist()
    for f in dict.fromkeys([*frequency.tolist(), *tones]):
        periods = f * seconds
        if (
            record.edge == "wrap"
            and (on_lines or f in tones)
            and (round(periods) < 1 or abs(periods - round(periods)) > WHOLE_PERIOD_TOLERANCE)
        ):
            remedy = _whole_cut(record, f) if chosen.incident is None else _nearest_line(record, f)
            raise ValueError(
                f"edge rule 'wrap' needs whole periods: {plane.name} holds {periods:.6g} periods of {f:g} Hz; {remedy}"
            )
        # One period of a broadband signal is long enough; its lines are the record's.
        if chosen.incident is None and (periods < FEWEST_PERIODS * (1 - 1e-6) and not chosen.allow_short):
            raise ValueError(
                f"{plane.name} holds {periods:.3g} periods of {f:g} Hz, fewer than "
                f"{FEWEST_PERIODS:g}; pass allow_short=True if that is meant"
            )
    notes += plane_unit_warnings(plane, float(frequency.min()))
    area = plane.area
    if area is not None and float(area.max()) > EVEN * float(area.min()):
        notes.append(
            f"{plane.name}: the areas of the probes differ, {float(area.min()):.3g} to "
            f"{float(area.max()):.3g} m2; averages weigh probes alike, not by area"
        )
    per_period = record.sampling_rate / float(frequency.max())
    if per_period < FEWEST_SAMPLES_PER_PERIOD:
        notes.append(
            f"{plane.name} has {per_period:.3g} samples per period of {float(frequency.max()):g} "
            f"Hz; |v| has corners, and below {FEWEST_SAMPLES_PER_PERIOD:g} they are not resolved"
        )
    duration = record.samples / record.sampling_rate
    if needs_kernels(chosen) and duration < BEFORE + AFTER:
        notes.append(
            f"{plane.name} lasts {1e3 * duration:.3g} ms, less than the kernel's "
            f"{1e3 * (BEFORE + AFTER):g} ms: the ends of the record reach all of it"
        )
    return notes


def _nearest_line(record: Record, frequency: float) -> str:
    spacing = record.sampling_rate / (record.samples - record.start)
    line = max(1, round(frequency / spacing)) * spacing
    return f"the record's lines are {spacing:.6g} Hz apart, the nearest is {line:.9g} Hz"


def _whole_cut(record: Record, frequency: float) -> str:
    """How many samples would hold whole periods, if any number does."""
    for samples in range(record.samples - 1, 0, -1):
        periods = samples * frequency / record.sampling_rate
        if periods < 1:
            break
        if abs(periods - round(periods)) <= WHOLE_PERIOD_TOLERANCE:
            return f"cut it to {samples} samples or use edge='finite'"
    return "no shorter record holds whole periods at this sampling rate; use edge='finite'"


def review_liner(plane: VelocityPlane, liner: LinerModel) -> list[str]:
    """As ``review_model``, and whether the plane lies within a cell of the liner."""
    return height_warnings(plane, liner.cell_pitch) + review_model(plane, liner)


def review_model(plane: VelocityPlane, liner: LinerModel) -> list[str]:
    """Whether liner and data state the same gas and flow, and whether flow would count twice."""
    notes, gas = [], liner.fluid
    if liner.flow_resistance > 0:
        notes.append(
            f"the law of liner {liner.describe().get('name', '')!r} adds "
            f"{liner.flow_resistance:.3g} rho c of resistance for grazing flow, but |v| as "
            f"measured in {plane.name} holds the turbulence already (Roncen et al. 2026, section "
            "2.4), so flow would count twice; set the law's mach to 0"
        )
    stated = liner.numbers().get("mach")
    if stated is not None and plane.mach is not None and abs(stated.value - plane.mach) > SAME_MACH:
        notes.append(
            f"mach is {stated.value:g} in the liner and {plane.mach:g} in {plane.name}; the "
            "liner's is used for the model: state the flow's there"
        )
    return notes if gas is None else notes + gas_warnings(gas, plane.fluid, plane.name)


def review_cells(plane: VelocityPlane, cells: Cells, used: Tensor) -> list[str]:
    """Cells that lose probes, or all of them, and with that the averages over cells."""
    kept = cells.kept(used)
    notes = []
    if gone := cells.count - kept.count:
        notes.append(
            f"{plane.name}: {gone} of {cells.count} cells hold no probe that is left; they count in no average"
        )
    if kept.weight is not None:
        short = kept.weight[kept.weight < 1]
        notes.append(
            f"{plane.name}: {len(short)} of {cells.count} cells have lost some of their probes; in "
            "averages over cells each weighs the share that it has, the least "
            f"{float(short.min()):.2g}"
        )
    return notes


def review_survey(plane: VelocityPlane, seen: Survey, used: Tensor) -> list[str]:
    """Probes that are dead or were left out."""
    notes = []
    excluded = int((~used).sum())
    if excluded:
        notes.append(f"{plane.name}: {excluded} of {plane.probes} probes hold nan or inf; excluded")
    flat = (seen.largest == seen.smallest)[: plane.probes].cpu() & used
    still = flat & (seen.largest[: plane.probes].cpu() == 0)
    if bool(still.any()):
        notes.append(
            f"{plane.name}: {int(still.sum())} of {plane.probes} probes are exactly 0 throughout, "
            f"the first at index {int(still.nonzero()[0])}; they educe the liner at rest"
        )
    elif bool(flat.any()) and not bool(flat[used].all()):
        notes.append(
            f"{plane.name}: {int(flat.sum())} of {plane.probes} probes are constant, the first "
            f"at index {int(flat.nonzero()[0])}; dead sensors look like this"
        )
    peak = float(seen.peak[: plane.probes].max())
    sound = float(plane.fluid.sound_speed)
    if peak > sound or not bool(torch.isfinite(seen.mean_square).all()):
        raise ValueError(
            f"{plane.name} reaches |v| = {peak:.4g} m/s, beyond the speed of sound, "
            f"{sound:.4g} m/s; check the unit of the data"
        )
    return notes


def review_coherent(
    plane: VelocityPlane,
    cells: Cells,
    periodic: PeriodicPart,
    asked: Tensor,
    liner: LinerModel,
    chosen: Choices,
) -> list[str]:
    """Where the coherent velocity of a cell is not what its name says."""
    notes = []
    if len(periodic.harmonics.lines) == 0:
        notes.append(
            f"{plane.name} states no tone, and {len(asked)} frequencies are asked for: of v only "
            "the mean is averaged over the cells; state frequency= of the data"
        )
    if plane.probes > 1 and int(torch.bincount(cells.labels[cells.labels >= 0]).max()) == 1:
        notes.append(
            f"{plane.name}: no cell holds more than one probe, so the coherent velocity of a cell "
            "is that of its probe, and 'coherent first' is 'probes first'; more probes a cell are "
            "needed"
        )
    if liner.cell_pitch is None and plane.x is not None:
        length = float(plane.x.max() - plane.x.min())
        wave = float(plane.fluid.sound_speed) / float(asked.max())
        if length > LONG_CELL * wave:
            notes.append(
                f"{plane.name}: the liner states no cell_pitch, so that all of {1e3 * length:.3g} "
                f"mm counts as one cell, {length / wave:.2g} wavelengths, over which the phase of "
                "the tone turns; state cell_pitch, or choose order='probes first'"
            )
    if not (periodic.has_shares or chosen.allow_short):
        notes.append(
            f"{plane.name} is too short to tell what of v is periodic and what is turbulence: "
            "all that a fit of the tones finds counts as periodic; "
            f"{FEWEST_BLOCKS} times {periodic.harmonics.period / plane.sampling_rate:.3g} s, in "
            "which the tones can be told apart, are the least"
        )
    return notes
