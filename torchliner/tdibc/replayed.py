"""What one pass over a plane gives: R under any phase rule, and the map."""

from __future__ import annotations

import functools
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import SAME_FREQUENCY, real_tensor
from torchliner.records import ImpedanceMap
from torchliner.replay.incident import LineSums, Means
from torchliner.replay.phase_rule import PhaseRule, phase_rule
from torchliner.tdibc.assemble import assemble
from torchliner.tdibc.block_deviations import block_deviations
from torchliner.tdibc.closure import with_closure
from torchliner.tdibc.intervals import Series, review_uncertainty, uncertainty_of
from torchliner.tdibc.prepared import Prepared

LEAST_DIRECTION = 0.9  # phases over 90 degrees, evenly


@dataclass(frozen=True)
class Replayed:
    """Sums of one pass, from which each phase rule gives a map without another pass."""

    prepared: Prepared
    sums: LineSums

    @functools.cached_property
    def means(self) -> Means:
        """What the phase rules take, of all columns."""
        of_moments = self.prepared.chosen.engine == "spectral"
        of = Means.of_emissions if of_moments else Means.of
        return of(self.sums, self.prepared.window_sums)

    def rule(self, phase: str, reference_phase: Any = None, coherent: tuple[Tensor, Tensor] | None = None) -> PhaseRule:
        """A phase rule with what it may know of this plane.

        Args:
            phase, reference_phase: as for ``map``.
            coherent: half the complex peak amplitude of the part of v into the liner that belongs
                to the sound, m/s, and its squared coherence, (N, F); default from the survey.
        Raises:
            ValueError: as ``map``.
        """
        prepared, device = self.prepared, self.sums.forward.device
        psi = _reference_phase(prepared, phase, reference_phase)
        velocity, coherence = coherent or (prepared.velocity_amplitude, prepared.survey.coherence)
        return phase_rule(phase)(
            velocity.to(device), coherence.to(device), prepared.chosen.minimum_coherence,
            None if coherent else min(prepared.survey.segments),
            None if psi is None else psi.to(device),
        )  # fmt: skip

    def map(self, phase: str = "averaged", reference_phase: Any = None, pressure: Any = None) -> ImpedanceMap:
        """The map under one phase rule.

        Args:
            phase: one of ``PHASE_RULES``.
            reference_phase: rad, for a rule that takes it.
            pressure: for closure, see ``known_pressure``.
        Raises:
            ValueError: the phase is missing, not asked for, or of a wrong shape.
        """
        prepared, rule = self.prepared, self.rule(phase, reference_phase)
        reflection = rule.reflection(self.means)
        wall, wall_notes = find_walls(prepared)
        notes = [
            *prepared.notes,
            *rule.notes(prepared.plane.probes, self.means, prepared.frequency),
        ]
        uncertainty, series = None, Series()
        if rule.phase is not None:
            notes += _review_phase(prepared, rule.phase.cpu())
        if self._keeps_blocks(rule):
            with torch.no_grad():
                deviations = block_deviations(prepared, rule, self.means)
                uncertainty, series = uncertainty_of(prepared, reflection.detach(), deviations, wall)
            notes += review_uncertainty(prepared, uncertainty)
        notes += wall_notes
        peak = 2 * prepared.velocity_amplitude
        found = assemble(prepared, phase, reflection, rule.held, peak, notes, uncertainty, wall)
        with torch.no_grad():
            return with_closure(prepared, found, series, pressure)

    def _keeps_blocks(self, rule: PhaseRule) -> bool:
        """Whether moments and survey kept the blocks that error bars under this rule need."""
        prepared, of_rms = self.prepared, self.prepared.chosen.drive == "rms"
        if prepared.blocks is None or not (of_rms or prepared.keeps_blocks):
            return False
        return prepared.survey.blocks is not None or not (rule.needs_velocity or of_rms)


def _reference_phase(prepared: Prepared, rule: str, phase: Any) -> Tensor | None:
    """psi of all columns, (N, F or 1); a cell's is the mean direction of the probes'."""
    if not phase_rule(rule).takes_phase:
        if phase is not None:
            raise ValueError(f"reference_phase is only used with phase='given', not {rule!r}")
        return None
    if phase is None:
        raise ValueError(f"phase={rule!r} needs reference_phase, in rad, one for all or per probe")
    values = real_tensor(phase).cpu()
    if not bool(torch.isfinite(values).all()):
        raise ValueError("reference_phase holds values that are not finite; it is in rad")
    shape, count = prepared.plane.probe_shape, len(prepared.frequency)
    if count > 1 and values.shape == (count,) and shape[-1:] == (count,):
        raise ValueError(
            f"reference_phase has shape ({count},), and there are {count} probes and {count} "
            "frequencies; give (probes, 1) or (1, frequencies)"
        )
    for candidate in (shape, (*shape, count)):
        try:
            psi = values.broadcast_to(candidate).reshape(prepared.plane.probes, -1)
        except RuntimeError:
            continue
        cells = _mean_direction(prepared, psi).angle()
        coherent = [psi] if prepared.periodic is not None else []
        return torch.cat([psi, cells, *coherent])
    raise ValueError(
        f"reference_phase has shape {tuple(values.shape)}; it must broadcast over probes of shape "
        f"{shape} (and {count} frequencies)"
    )


def _mean_direction(prepared: Prepared, psi: Tensor) -> Tensor:
    """Mean of e^{j psi} over each cell's probes, (C, F or 1)."""
    return prepared.cells.average(torch.exp(1j * psi), prepared.used)


def _review_phase(prepared: Prepared, psi: Tensor) -> list[str]:
    """Phases so far apart within a cell that their mean direction says little, or nothing."""
    length = _mean_direction(prepared, psi[: prepared.plane.probes]).abs()
    wide = length < LEAST_DIRECTION
    if not bool(wide.any()):
        return []
    return [
        f"reference_phase differs within {int(wide.any(1).sum())} of {prepared.cells.count} cells: "
        f"the mean of e^(j psi) is as short as {float(length.min()):.2g} (1 where all agree, limit "
        f"{LEAST_DIRECTION:g}), so that the one phase of such a cell, and its value with velocity "
        "first, mean little; use the probes' values"
    ]


def find_walls(prepared: Prepared) -> tuple[Tensor | None, list[str]]:
    """Probes whose squared coherence with the tone is below ``wall_filter``, and what to say.

    Args:
        prepared: prepared plane.
    Returns:
        (P, F) bool, None without a filter; notes with the share of such probes.
    Source: Roncen et al. (2026), section 7.2, which names no threshold and no estimator; the
        coherence here is that of ``survey``, over segments of few periods.
    """
    limit = prepared.chosen.wall_filter
    if limit is None:
        return None, []
    probes, segments = prepared.plane.probes, prepared.survey.segments
    kept = prepared.used.to(prepared.survey.coherence.device)
    wall = (prepared.survey.coherence[:probes] < limit) & kept[:, None]
    counts = wall.sum(0)
    notes = []
    known = zip(prepared.frequency.tolist(), counts.tolist(), segments, strict=True)
    for f, count, behind in known:
        chance = (1 - limit) ** (behind - 1)
        total = int(kept.sum())
        text = (
            f"wall filter: {count} of {total} probes ({100 * count / total:.3g} %) of "
            f"{prepared.plane.name} have a squared coherence below {limit:g} with {f:g} Hz and "
            "count as wall, admittance 0, in the averages over probes; those with velocity first "
            f"are as without the filter. Without any tone {100 * chance:.2g} % of probes would "
            f"pass it, with {behind} segments"
        )
        tone = prepared.plane.frequency
        if tone is not None and abs(f / tone - 1) > SAME_FREQUENCY:
            text += f"; the tone of the data is {tone:g} Hz, so this filters turbulence, not sound"
        notes.append(text)
    return wall, notes
