"""What one pass over a plane gives: R under any phase rule, and the map."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import real_tensor
from torchliner.records import ImpedanceMap
from torchliner.replay.incident import LineSums, Means, given_reflection, self_consistent_reflection
from torchliner.tdibc.assemble import assemble
from torchliner.tdibc.block_deviations import BlockDeviations
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.intervals import review_uncertainty, uncertainty_of
from torchliner.tdibc.prepared import Prepared


@dataclass(frozen=True)
class CoherentPart:
    """The part of v that belongs to the sound.

    Args:
        amplitude: half the complex peak amplitude of v into the liner, m/s, (P + C, F).
        coherence: squared, 0 to 1, (P + C, F).
    """

    amplitude: Tensor
    coherence: Tensor


@dataclass(frozen=True)
class Reflection:
    """R of probes and cell averages under one phase rule.

    Args:
        value: R, (P + C, F).
        held: whether the rule held there.
        means: what R was made of.
        phase: psi of ``given``, rad, (P + C, F or 1).
        notes: doubts.
    """

    value: Tensor
    held: Tensor
    means: Means
    phase: Tensor | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True)
class Replayed:
    """Sums of one pass, from which each phase rule gives a map without another pass."""

    ready: Prepared
    sums: LineSums

    def map(self, phase: str = "averaged", reference_phase: Any = None) -> ImpedanceMap:
        """The map under one phase rule.

        Args:
            phase: ``averaged``, ``self-consistent`` or ``given``.
            reference_phase: rad, for ``given``.
        Raises:
            ValueError: the phase is missing, not asked for, or of a wrong shape.
        """
        ready = self.ready
        found = self.reflection(phase, reference_phase)
        reflection, notes = found.value, [*ready.notes, *found.notes]
        wall, said = find_walls(ready)
        moved = self._deviations(phase, found)
        uncertainty = None
        if moved is not None:
            with torch.no_grad():
                uncertainty = uncertainty_of(ready, reflection.detach(), moved, wall)
            notes += review_uncertainty(ready, uncertainty)
        notes += said
        peak = 2 * ready.velocity_amplitude
        return assemble(ready, phase, reflection, found.held, peak, notes, uncertainty, wall)

    def reflection(
        self, phase: str, reference_phase: Any = None, coherent: CoherentPart | None = None
    ) -> Reflection:
        """R under one phase rule.

        Args:
            phase, reference_phase: as for ``map``.
            coherent: the part of v that belongs to the sound, for ``self-consistent``; default
                what the survey found.
        Raises:
            ValueError: as ``map``.
        """
        ready, window, device = self.ready, self.ready.window_sums, self.sums.forward.device
        psi = _reference_phase(ready, phase, reference_phase)
        sums = self.sums if phase != "averaged" else LineSums(self.sums.forward, None)
        means = Means.of(sums, window)
        held = torch.ones(means.a.shape, dtype=torch.bool, device=device)
        if psi is not None:
            return Reflection(given_reflection(means, psi.to(device)), held, means, psi)
        if phase != "self-consistent":
            return Reflection(means.a, held, means)
        known = coherent or CoherentPart(ready.velocity_amplitude, ready.seen.coherence)
        found, _ = self_consistent_reflection(
            means, known.amplitude.to(device) / ready.plane.fluid.sound_speed
        )
        held = known.coherence.to(device) >= ready.chosen.minimum_coherence
        averaged = Means.of(LineSums(self.sums.forward, None), window).a
        notes = _fallback_note(held[: ready.plane.probes], ready.chosen)
        notes += [] if coherent else _chance_note(ready)
        return Reflection(torch.where(held, found, averaged), held, means, notes=tuple(notes))

    def _deviations(self, phase: str, found: Reflection) -> BlockDeviations | None:
        """None where the sums, or the survey, did not keep the blocks that this rule needs."""
        ready, of_rms = self.ready, self.ready.chosen.drive == "rms"
        wants_velocity = phase == "self-consistent" or of_rms
        missing = self.sums.blocks is None and not of_rms
        if ready.blocks is None or missing or (wants_velocity and ready.seen.blocks is None):
            return None
        return BlockDeviations(ready, self.sums.blocks, phase, found.phase, found.means, found.held)


def _fallback_note(held: Tensor, chosen: Choices) -> list[str]:
    if bool(held.all()):
        return []
    return [
        f"self-consistent phase: {int((~held).sum())} of {held.numel()} values have a coherence "
        f"below {chosen.minimum_coherence:g} with the tone; they are 'averaged' instead"
    ]


def _chance_note(ready: Prepared) -> list[str]:
    """Few segments let turbulence pass as a tone: with S of them, (1 - limit)^(S - 1) of probes."""
    chance = (1 - ready.chosen.minimum_coherence) ** (ready.seen.segments - 1)
    if chance <= 0.01 or ready.chosen.minimum_coherence == 0:
        return []
    return [
        f"self-consistent phase: with {ready.seen.segments} segments of two periods, "
        f"{100 * chance:.2g} % of probes pass a coherence of {ready.chosen.minimum_coherence:g} "
        "without any tone; a longer record or a higher minimum_coherence is safer"
    ]


def _reference_phase(ready: Prepared, rule: str, phase: Any) -> Tensor | None:
    """psi of probes and cells, (P + C, F or 1); a cell's is the mean direction of the probes'."""
    if rule != "given":
        if phase is not None:
            raise ValueError(f"reference_phase is only used with phase='given', not {rule!r}")
        return None
    if phase is None:
        raise ValueError("phase='given' needs reference_phase, in rad, one for all or per probe")
    values = real_tensor(phase).cpu()
    if not bool(torch.isfinite(values).all()):
        raise ValueError("reference_phase holds values that are not finite; it is in rad")
    shape, count = ready.plane.probe_shape, len(ready.frequency)
    for candidate in (shape, (*shape, count)):
        try:
            psi = values.broadcast_to(candidate).reshape(ready.plane.probes, -1)
        except RuntimeError:
            continue
        weights = ready.cells.membership(ready.used).to(torch.complex128)
        cells = (weights.T @ torch.exp(1j * psi)).angle()
        return torch.cat([psi, cells])
    raise ValueError(
        f"reference_phase has shape {tuple(values.shape)}; it must broadcast over probes of shape "
        f"{shape} (and {count} frequencies)"
    )


SAME_TONE = 1e-6  # relative


def find_walls(ready: Prepared) -> tuple[Tensor | None, list[str]]:
    """Probes whose squared coherence with the tone is below ``wall_filter``, and what to say.

    Args:
        ready: prepared plane.
    Returns:
        (P, F) bool, None without a filter; notes with the share of such probes.
    Source: Roncen et al. (2026), section 7.2, which names no threshold and no estimator; the
        coherence here is that of ``survey``, over segments of two periods.
    """
    limit = ready.chosen.wall_filter
    if limit is None:
        return None, []
    probes, segments = ready.plane.probes, ready.seen.segments
    kept = ready.used.to(ready.seen.coherence.device)
    wall = (ready.seen.coherence[:probes] < limit) & kept[:, None]
    counts = wall.sum(0)
    chance = (1 - limit) ** (segments - 1)
    notes = []
    for f, count in zip(ready.frequency.tolist(), counts.tolist(), strict=True):
        total = int(kept.sum())
        text = (
            f"wall filter: {count} of {total} probes ({100 * count / total:.3g} %) of "
            f"{ready.plane.name} have a squared coherence below {limit:g} with {f:g} Hz and count "
            "as wall, admittance 0, in the averages over probes; those with velocity first are as "
            f"without the filter. Without any tone {100 * chance:.2g} % of probes would pass it, "
            f"with {segments} segments"
        )
        tone = ready.plane.frequency
        if tone is not None and abs(f / tone - 1) > SAME_TONE:
            text += f"; the tone of the data is {tone:g} Hz, so this filters turbulence, not sound"
        notes.append(text)
    return wall, notes
