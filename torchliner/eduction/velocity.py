"""DIR-TDIBC: impedance from wall-normal velocity, probe by probe, without a propagation model."""

from __future__ import annotations

import dataclasses
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import DataWarning, real_tensor
from torchliner.eduction.assemble import assemble
from torchliner.eduction.block_deviations import BlockDeviations
from torchliner.eduction.broadband import educe_signal
from torchliner.eduction.choices import Choices
from torchliner.eduction.engines import tone_sums
from torchliner.eduction.prepare import Prepared, Progress, prepare
from torchliner.eduction.recovery import with_smaller_slabs
from torchliner.eduction.uncertainty import review_uncertainty, uncertainty_of
from torchliner.eduction.walls import find_walls
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.replay.incident import (
    LineSums,
    Means,
    given_reflection,
    self_consistent_reflection,
)
from torchliner.replay.kernels import Liner


def educe(
    plane: Any,
    liner: Liner,
    frequency: Any = None,
    *,
    reference_phase: Any = None,
    reflected: str | Path | None = None,
    progress: Progress | None = None,
    **choices: Any,
) -> Any:
    """Impedance map of a plane: a known wave replayed through a liner driven by |v(t)|.

    The educed reflection is the window-weighted mean of the liner model's own R(f, |v(t)|) (plus
    its 2 f line once a phase is stated): it is the response of YOUR model to YOUR velocity data.

    Args:
        plane: wall-normal velocity, (..., T) m/s; or several planes, which then share velocity
            levels and kernels, so that their maps can be compared to the last digit.
        liner: ``SDoFLiner``, ``TabulatedLiner`` or any object with ``impedance(frequency, speed)``.
        frequency: Hz, one or several; default the plane's own tone; with ``Tones`` these, with
            ``Sweep`` and ``BandNoise`` the lines of the segments in their band, 200 at most.
        reference_phase: psi in rad for ``phase="given"``: x(t) = cos(2 pi f t + psi) with t = 0 at
            the first sample; broadcast over the probe axes (add a last axis for several
            frequencies).
        reflected: file to write the reflected signal of every probe to (docs/formats.md); needs an
            incident signal.
        progress: called with numbers of samples done, 2 T a plane in all.
        choices: see ``torchliner.eduction.choices.Choices``.
    Returns:
        The map, on the probe axes of the plane, with cell and liner averages in both orders; a
        list of maps for several planes.
    Raises:
        ValueError: data or options that cannot give an answer; the message says what would.
        TypeError: a value of the wrong kind.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), section 3. Departures: two-sided kernels, edge rules, phase rules
        and drives are named (docs/method.md), and the errors of kernel and levels are reported.
    """
    several = isinstance(plane, (list, tuple))
    planes = list(plane) if several else [plane]
    for each in planes:
        if not isinstance(each, VelocityPlane):
            raise TypeError(
                f"plane is {type(each).__name__}; make a VelocityPlane of your data first"
            )
    if not planes:
        raise ValueError("no plane is given")
    if not hasattr(liner, "impedance"):
        raise TypeError(
            f"liner is {liner!r}, without impedance(frequency, speed); presets and files are read "
            "by load_liner"
        )
    chosen = Choices(**choices)
    _check_signal_output(chosen, reference_phase, reflected, len(planes))
    found = []
    for ready in prepare(planes, liner, frequency, chosen, progress):
        if chosen.incident is not None:
            result = educe_signal(ready, reflected, progress)
        else:
            replayed = replay(ready, backward=chosen.phase != "averaged", progress=progress)
            result = replayed.map(chosen.phase, reference_phase)
        for note in result.notes:
            warnings.warn(note, DataWarning, stacklevel=2)
        found.append(result)
    return found if several else found[0]


def _check_signal_output(chosen: Choices, reference_phase: Any, reflected: Any, count: int) -> None:
    if chosen.incident is None and reflected is not None:
        raise ValueError(
            "a reflected signal needs an incident one; name it, e.g. incident='noise:300:3500' or "
            "Tones(1400.0)"
        )
    if reflected is not None and count > 1:
        raise ValueError("several planes would share one reflected file; educe them one by one")
    if chosen.incident is not None and reference_phase is not None:
        raise ValueError("reference_phase is for tones; an incident signal has its own phase")


def replay(ready: Prepared, *, backward: bool = True, progress: Progress | None = None) -> Replayed:
    """The pass over the data that ``educe`` makes for tones; any phase rule is then read off it.

    Args:
        ready: of ``prepare``.
        backward: False saves half the sums if only ``averaged`` is wanted.
        progress: called with numbers of samples done.
    """
    sums, notes = with_smaller_slabs(
        ready.drive.velocity, lambda: tone_sums(ready, backward, progress)
    )
    return Replayed(dataclasses.replace(ready, notes=(*ready.notes, *notes)), sums)


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
        device = self.sums.forward.device
        window, amplitude = ready.window_sums, ready.velocity_amplitude
        psi = _reference_phase(ready, phase, reference_phase)
        sums = self.sums if phase != "averaged" else LineSums(self.sums.forward, None)
        means = Means.of(sums, window)
        held = torch.ones(means.a.shape, dtype=torch.bool, device=device)
        notes = list(ready.notes)
        reflection = means.a
        if psi is not None:
            reflection = given_reflection(means, psi.to(device))
        elif phase == "self-consistent":
            wave = amplitude / ready.plane.fluid.sound_speed
            found, _ = self_consistent_reflection(means, wave)
            held = ready.seen.coherence >= ready.chosen.minimum_coherence
            averaged = Means.of(LineSums(self.sums.forward, None), window).a
            reflection = torch.where(held, found, averaged)
            notes += _fallback_note(held[: ready.plane.probes], ready.chosen)
            notes += _chance_note(ready)
        wall, said = find_walls(ready)
        moved = self._deviations(phase, psi, means, held)
        uncertainty = None
        if moved is not None:
            with torch.no_grad():
                uncertainty = uncertainty_of(ready, reflection.detach(), moved, wall)
            notes += review_uncertainty(ready, uncertainty)
        notes += said
        return assemble(ready, phase, reflection, held, 2 * amplitude, notes, uncertainty, wall)

    def _deviations(
        self, phase: str, psi: Tensor | None, means: Means, held: Tensor
    ) -> BlockDeviations | None:
        """None where the sums, or the survey, did not keep the blocks that this rule needs."""
        ready, of_rms = self.ready, self.ready.chosen.drive == "rms"
        wants_velocity = phase == "self-consistent" or of_rms
        missing = self.sums.blocks is None and not of_rms
        if ready.blocks is None or missing or (wants_velocity and ready.seen.blocks is None):
            return None
        return BlockDeviations(ready, self.sums.blocks, phase, psi, means, held)


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
