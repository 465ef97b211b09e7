"""DIR-TDIBC: impedance from wall-normal velocity, probe by probe, without a propagation model."""

from __future__ import annotations

import math
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import DataWarning, frequency_tensor, real_tensor
from torchliner.eduction.averaging import Cells, sort_into_cells
from torchliner.eduction.choices import Choices
from torchliner.eduction.drive import DriveSpeed, ProbeVelocity
from torchliner.eduction.review import review_liner, review_record, review_survey
from torchliner.eduction.survey import Survey, survey
from torchliner.liners.grazing import goodrich_resistance
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.replay.direct import direct_sums
from torchliner.replay.edges import EdgeTable, Record
from torchliner.replay.incident import (
    LineSums,
    Means,
    WindowSums,
    given_reflection,
    self_consistent_reflection,
)
from torchliner.replay.kernels import KernelTable, Liner, build_kernels, impedance_of
from torchliner.replay.levels import VelocityGrid
from torchliner.replay.spectral import interpolation_error, response_of, spectral_sums
from torchliner.signals.windows import make_window

Progress = Callable[[int], None]


def educe(
    plane: VelocityPlane,
    liner: Liner,
    frequency: Any = None,
    *,
    reference_phase: Any = None,
    progress: Progress | None = None,
    **choices: Any,
) -> ImpedanceMap:
    """Impedance map of a plane: a known tone replayed through a liner driven by |v(t)|.

    The educed reflection is the window-weighted mean of the liner model's own R(f, |v(t)|) (plus
    its 2 f line once a phase is stated): it is the response of YOUR model to YOUR velocity data.

    Args:
        plane: wall-normal velocity, (..., T) m/s.
        liner: ``SDoFLiner``, ``TabulatedLiner`` or any object with ``impedance(frequency, speed)``.
        frequency: Hz, one or several; default the plane's own tone.
        reference_phase: psi in rad for ``phase="given"``: x(t) = cos(2 pi f t + psi) with t = 0 at
            the first sample; broadcast over the probe axes (add a last axis for several
            frequencies).
        progress: called with numbers of samples done, 2 T in all.
        choices: see ``torchliner.eduction.choices.Choices``.
    Returns:
        The map, on the probe axes of the plane, with cell and liner averages in both orders.
    Raises:
        ValueError: data or options that cannot give an answer; the message says what would.
        TypeError: a value of the wrong kind.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), section 3. Departures: two-sided kernels, edge rules, phase rules
        and drives are named (PHYSICS: docs/method.md), and error of kernel and levels is reported.
    """
    chosen = Choices(**choices)
    wanted = _frequencies(plane, frequency)
    phase = _reference_phase(plane, wanted, chosen, reference_phase)
    record = _record(plane, wanted, chosen)
    notes = review_record(plane, wanted, record, chosen) + review_liner(plane, liner)

    cells = sort_into_cells(plane, getattr(liner, "cell_pitch", None))
    velocity, seen, used = _survey(plane, cells, wanted, record, chosen, progress)
    notes += review_survey(plane, seen, used, chosen)
    drive = _drive(velocity, seen, wanted, plane.sampling_rate, chosen)
    grid = _velocity_grid(plane, liner, seen, used, chosen)
    kernels = _kernels(liner, grid, wanted, record, chosen)

    sums = _run(drive, liner, wanted, record, grid, kernels, chosen, progress)
    window = WindowSums.of(record.window.weights, record.start, wanted, plane.sampling_rate)
    window = WindowSums(window.zero.to(velocity.device), window.twice.to(velocity.device))
    # v into the liner is -v.
    amplitude = window.tone_amplitude(-seen.line)
    reflection, ruled = _apply_phase_rule(
        Means.of(sums, window), amplitude / plane.fluid.sound_speed, seen, phase, chosen
    )
    if chosen.phase == "self-consistent" and not bool(ruled.all()):
        share = int((~ruled).sum())
        notes.append(
            f"self-consistent phase: {share} of {ruled.numel()} values have a coherence below "
            f"{chosen.minimum_coherence:g} with the tone; they are 'averaged' instead"
        )
    for note in notes:
        warnings.warn(note, DataWarning, stacklevel=2)
    facts = _facts(plane, liner, chosen, grid, kernels, wanted, seen)
    return _assemble(
        plane, liner, wanted, cells, used, seen, reflection, ruled, 2 * amplitude, facts, notes
    )


def _frequencies(plane: VelocityPlane, frequency: Any) -> Tensor:
    if frequency is None:
        frequency = plane.frequency
    if frequency is None:
        raise ValueError(f"{plane.name} states no frequency; give frequency=..., in Hz")
    return frequency_tensor(frequency, plane.sampling_rate).cpu()


def _reference_phase(
    plane: VelocityPlane, frequency: Tensor, chosen: Choices, phase: Any
) -> Tensor | None:
    if chosen.phase != "given":
        if phase is not None:
            raise ValueError(
                f"reference_phase is only used with phase='given', not {chosen.phase!r}"
            )
        return None
    if phase is None:
        raise ValueError("phase='given' needs reference_phase, in rad, one for all or per probe")
    values = real_tensor(phase).cpu()
    shape = plane.probe_shape
    for candidate in (shape, (*shape, len(frequency))):
        try:
            spread = values.broadcast_to(candidate)
        except RuntimeError:
            continue
        return spread.reshape(plane.probes, -1)
    raise ValueError(
        f"reference_phase has shape {tuple(values.shape)}; it must broadcast over probes of shape "
        f"{shape} (and {len(frequency)} frequencies)"
    )


def _record(plane: VelocityPlane, frequency: Tensor, chosen: Choices) -> Record:
    start = round(chosen.pre_roll * plane.sampling_rate)
    if start >= plane.samples:
        raise ValueError(
            f"pre_roll is {chosen.pre_roll:g} s, but {plane.name} lasts {plane.duration:g} s"
        )
    window = make_window(chosen.window, plane.samples - start)
    return Record(plane.samples, start, window, chosen.edge, plane.sampling_rate)


def _survey(
    plane: VelocityPlane,
    cells: Cells,
    frequency: Tensor,
    record: Record,
    chosen: Choices,
    progress: Progress | None,
) -> tuple[ProbeVelocity, Survey, Tensor]:
    """First pass: over the probes and the cell averages; faulty probes are found and left out."""
    like = plane.velocity
    device = chosen.working_device(like.device if isinstance(like, Tensor) else torch.device("cpu"))
    dtype = chosen.working_dtype(like.dtype)
    weights = torch.zeros(plane.samples, dtype=torch.float64)
    weights[record.start :] = record.window.weights
    everything = torch.ones(plane.probes, dtype=torch.bool)

    def look(used: Tensor, report: Progress | None) -> tuple[ProbeVelocity, Survey]:
        velocity = ProbeVelocity(plane, cells.membership(used), dtype, device, used)
        return velocity, survey(velocity, frequency, plane.sampling_rate, weights, report)

    velocity, seen = look(everything, progress)
    used = (seen.bad[: plane.probes] == 0).cpu()
    if not bool(used.all()):
        _refuse_bad_probes(plane, seen, used, chosen)
        velocity, seen_again = look(used, None)
        seen = seen_again
    return velocity, seen, used


def _refuse_bad_probes(plane: VelocityPlane, seen: Survey, used: Tensor, chosen: Choices) -> None:
    first = int((~used).nonzero()[0])
    place = tuple(int(i) for i in torch.unravel_index(torch.tensor(first), plane.probe_shape))
    text = (
        f"{plane.name} holds {int(seen.bad[: plane.probes].sum())} nan or inf at "
        f"{int((~used).sum())} of {plane.probes} probes, the first at probe {place}, sample "
        f"{int(seen.first_bad[first])}"
    )
    if chosen.missing == "refuse":
        raise ValueError(f"{text}; repair them, or leave these probes out with missing='exclude'")
    if not bool(used.any()):
        raise ValueError(f"{text}; no probe is left")


def _drive(
    velocity: ProbeVelocity, seen: Survey, frequency: Tensor, rate: float, chosen: Choices
) -> DriveSpeed:
    running = chosen.running_window or 1 / float(frequency.min())
    return DriveSpeed(velocity, chosen.drive, chosen.mean, seen, max(1, round(running * rate)))


def _velocity_grid(
    plane: VelocityPlane, liner: Liner, seen: Survey, used: Tensor, chosen: Choices
) -> VelocityGrid:
    """Levels over the whole record's range; the top is rounded up so that the tables, and with
    them the last digits of a probe, rarely depend on which other probes are in the plane."""
    peak = torch.maximum(seen.largest.abs(), seen.smallest.abs())
    if chosen.mean == "removed":
        peak = peak + seen.mean.abs()
    fastest = int(peak[: plane.probes].argmax())
    top = float(peak[fastest])
    limit = chosen.velocity_max
    table_limit = getattr(liner, "speed_max", None)
    if limit is None:
        limit = 2.0 ** (math.ceil(2 * math.log2(max(top, 1e-3))) / 2) * (1 + 1e-9)
        if table_limit is not None:
            limit = min(limit, table_limit)
    if top > limit or (table_limit is not None and limit > table_limit):
        place = tuple(int(i) for i in torch.unravel_index(torch.tensor(fastest), plane.probe_shape))
        kind = "velocity_max" if chosen.velocity_max is not None else "the liner's table"
        ceiling = limit if table_limit is None else min(limit, table_limit)
        raise ValueError(
            f"{plane.name} reaches |v| = {top:.4g} m/s at probe {place}, above {kind}, "
            f"{ceiling:.4g} m/s; extend it to at least {top * 1.01:.3g} m/s"
        )
    return VelocityGrid(limit, chosen.levels, chosen.spacing, chosen.interpolation)


def _kernels(
    liner: Liner, grid: VelocityGrid, frequency: Tensor, record: Record, chosen: Choices
) -> KernelTable | None:
    needed = (
        chosen.engine == "direct"
        or chosen.uses_kernel_response
        or any(record.needs_table(float(f)) for f in frequency)
    )
    if not needed:
        return None
    low, high = chosen.band
    known = getattr(liner, "frequency_range", None)
    if known is not None:
        low, high = max(low, known[0]), min(high, known[1])
    kernels = build_kernels(liner, grid, record.sampling_rate, kind=chosen.kernel, band=(low, high))
    kernels.require_band(frequency)
    return kernels


def _run(
    drive: DriveSpeed,
    liner: Liner,
    frequency: Tensor,
    record: Record,
    grid: VelocityGrid,
    kernels: KernelTable | None,
    chosen: Choices,
    progress: Progress | None,
) -> LineSums:
    backward = chosen.phase != "averaged"
    if chosen.engine == "direct":
        assert kernels is not None
        sums = direct_sums(drive.read(0, drive.samples).T, kernels, frequency, record)
        if progress is not None:
            progress(drive.samples)
        return sums if backward else LineSums(sums.forward, None)
    standing = kernels if chosen.uses_kernel_response else None
    responses, tables = [], []
    for value in frequency.tolist():
        lines, _ = record.line_frequencies(value)
        responses.append(response_of(liner, lines, grid, standing))
        needs = record.needs_table(value)
        tables.append(EdgeTable(kernels, record, value) if needs and kernels else None)
    return spectral_sums(
        drive, responses, frequency, record, tables, grid, backward=backward, progress=progress
    )


def _apply_phase_rule(
    means: Means, velocity: Tensor, seen: Survey, phase: Tensor | None, chosen: Choices
) -> tuple[Tensor, Tensor]:
    """R (P + C, F) and where the rule asked for was used."""
    everywhere = torch.ones(means.a.shape, dtype=torch.bool, device=means.a.device)
    if chosen.phase == "given":
        assert phase is not None
        phase = phase.to(means.a.device)
        extra = means.a.shape[0] - phase.shape[0]
        # A cell's wave has the mean phase of the plane's.
        turned = torch.exp(1j * phase).mean(0, keepdim=True).angle().expand(extra, -1)
        return given_reflection(means, torch.cat([phase, turned])), everywhere
    if chosen.phase == "self-consistent":
        found, _ = self_consistent_reflection(means, velocity)
        steady = seen.coherence >= chosen.minimum_coherence
        return torch.where(steady, found, means.a), steady
    return means.a, everywhere


@dataclass(frozen=True)
class _Split:
    """Probe rows and cell rows of a (P + C, ...) tensor."""

    shape: tuple[int, ...]
    probes: int

    def probe(self, value: Tensor) -> Tensor:
        return value[: self.probes].reshape(*self.shape, *value.shape[1:])

    def cell(self, value: Tensor) -> Tensor:
        return value[self.probes :]


def _facts(
    plane: VelocityPlane,
    liner: Liner,
    chosen: Choices,
    grid: VelocityGrid,
    kernels: KernelTable | None,
    frequency: Tensor,
    seen: Survey,
) -> dict[str, Any]:
    from torchliner import __version__

    facts: dict[str, Any] = {"version": __version__, **chosen.describe()}
    facts["velocity_max"] = grid.maximum
    facts["coherence_segments"] = seen.segments
    describe = getattr(liner, "describe", None)
    facts["liner"] = describe() if describe else {"model": type(liner).__name__}
    facts["sampling_rate"], facts["samples"] = plane.sampling_rate, plane.samples
    facts["data"] = dict(plane.provenance)
    facts["source_file"] = plane.name
    if kernels is not None:
        facts["kernel_error"] = kernels.error
        facts["kernel_gain"] = kernels.gain
        facts["kernel_band"] = list(kernels.band)
    tabulated = chosen.uses_kernel_response or chosen.engine == "direct"
    if tabulated or not hasattr(liner, "speed_law"):
        with torch.no_grad():
            errors = [interpolation_error(liner, f, grid) for f in frequency.tolist()]
        facts["level_error"] = max(errors)
    return facts


def _assemble(
    plane: VelocityPlane,
    liner: Liner,
    frequency: Tensor,
    cells: Cells,
    used: Tensor,
    seen: Survey,
    reflection: Tensor,
    ruled: Tensor,
    peak: Tensor,
    facts: dict[str, Any],
    notes: list[str],
) -> ImpedanceMap:
    split = _Split(plane.probe_shape, plane.probes)
    kept = used.to(reflection.device)
    cell_reflection = cells.average_reflection(reflection[: plane.probes], kept)
    gap = torch.full_like(reflection[: plane.probes], torch.nan)
    shown = torch.where(kept[:, None], reflection[: plane.probes], gap)
    goodrich = None
    porosity = getattr(liner, "surface_porosity", None)
    if plane.mach and plane.displacement_thickness and porosity:
        diameter = float(liner.orifice_diameter)  # type: ignore[attr-defined]
        added = goodrich_resistance(plane.mach, porosity, plane.displacement_thickness, diameter)
        with torch.no_grad():
            goodrich = impedance_of(liner, frequency, torch.zeros(1)) + added
    return ImpedanceMap(
        frequency=frequency,
        reflection=split.probe(torch.cat([shown, reflection[plane.probes :]])),
        mean_velocity=split.probe(seen.mean),
        velocity_rms=split.probe(seen.rms),
        velocity_amplitude=split.probe(peak),
        coherence=split.probe(seen.coherence),
        phase_rule=split.probe(ruled),
        cell_x=cells.x,
        cell_z=cells.z,
        cell_reflection=cell_reflection,
        cell_reflection_velocity_first=split.cell(reflection),
        x=plane.x,
        z=plane.z,
        height=plane.height,
        fluid=plane.fluid,
        reference=dict(plane.reference),
        mach=plane.mach,
        incident_level=plane.incident_level,
        source_side=plane.source_side,
        goodrich=goodrich,
        title=plane.title,
        choices=facts,
        notes=tuple(notes),
    )
