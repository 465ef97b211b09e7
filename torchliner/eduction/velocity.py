"""DIR-TDIBC: impedance from wall-normal velocity, probe by probe, without a propagation model."""

from __future__ import annotations

import warnings
from dataclasses import dataclass
from typing import Any

import torch
from torch import Tensor

from torchliner.checks import DataWarning, plain_number, real_tensor
from torchliner.eduction.choices import Choices
from torchliner.eduction.prepare import Prepared, Progress, prepare
from torchliner.liners.grazing import goodrich_resistance
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.replay.direct import direct_sums
from torchliner.replay.incident import (
    LineSums,
    Means,
    WindowSums,
    given_reflection,
    self_consistent_reflection,
)
from torchliner.replay.kernels import Liner, impedance_of
from torchliner.replay.spectral import interpolation_error, plan_line, spectral_sums


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
        and drives are named (docs/method.md), and the errors of kernel and levels is reported.
    """
    if not isinstance(plane, VelocityPlane):
        raise TypeError(f"plane is {type(plane).__name__}; make a VelocityPlane of your data first")
    if not hasattr(liner, "impedance"):
        raise TypeError(
            f"liner is {liner!r}, without impedance(frequency, speed); presets and files are read "
            "by load_liner"
        )
    chosen = Choices(**choices)
    needs_backward = chosen.phase != "averaged"
    replayed = replay(plane, liner, frequency, chosen, backward=needs_backward, progress=progress)
    result = replayed.map(chosen.phase, reference_phase)
    for note in result.notes:
        warnings.warn(note, DataWarning, stacklevel=2)
    return result


def replay(
    plane: VelocityPlane,
    liner: Liner,
    frequency: Any,
    chosen: Choices,
    *,
    backward: bool = True,
    progress: Progress | None = None,
) -> Replayed:
    """The pass over the data that ``educe`` makes; any phase rule can then be read off it.

    Args:
        plane, liner, frequency, progress: as for ``educe``.
        chosen: all choices but the phase rule.
        backward: False saves half the sums if only ``averaged`` is wanted.
    """
    ready = prepare(plane, liner, frequency, chosen, progress)
    return Replayed(ready, _run(ready, backward, progress))


def _run(ready: Prepared, backward: bool, progress: Progress | None) -> LineSums:
    record, drive, chosen = ready.record, ready.drive, ready.chosen
    if chosen.engine == "direct":
        assert ready.kernels is not None
        whole = [(0, drive.samples)]
        speed = torch.cat([part.speed for slab in drive.slabs(whole) for part in slab], dim=1)
        sums = direct_sums(speed.T, ready.kernels, ready.frequency, record)
        if progress is not None:
            progress(drive.samples)
        return sums if backward else LineSums(sums.forward, None)
    lines = [
        plan_line(
            ready.liner, value, record, ready.grid, ready.kernels,
            of_kernel=chosen.uses_kernel_response, backward=backward,
        )
        for value in ready.frequency.tolist()
    ]  # fmt: skip
    return spectral_sums(drive, lines, ready.grid, compile_loops=chosen.compile, progress=progress)


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
        rate, device = ready.plane.sampling_rate, self.sums.forward.device
        window = WindowSums.of(
            ready.record.window.weights, ready.record.start, ready.frequency, rate
        )
        window = WindowSums(window.zero.to(device), window.twice.to(device))
        # v into the liner is -v.
        amplitude = window.tone_amplitude(-ready.seen.line)
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
        return _assemble(ready, phase, reflection, held, 2 * amplitude, notes)


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


def _facts(ready: Prepared, phase: str) -> dict[str, Any]:
    """Every choice, and what followed from it."""
    from torchliner import __version__

    plane, chosen, kernels = ready.plane, ready.chosen, ready.kernels
    facts: dict[str, Any] = {"version": __version__, **chosen.describe(), "phase": phase}
    describe = getattr(ready.liner, "describe", None)
    facts["liner"] = describe() if describe else {"model": type(ready.liner).__name__}
    facts |= {
        "velocity_max": ready.grid.maximum,
        "coherence_segments": ready.seen.segments,
        "sampling_rate": plane.sampling_rate,
        "samples": plane.samples,
        "source": plane.name,
        "surface": plane.liner,
        "data": dict(plane.provenance),
    }
    if kernels is not None:
        facts["kernel_error"], facts["kernel_gain"] = kernels.error, kernels.gain
        facts["kernel_band"] = list(kernels.band)
    if facts["response"] == "kernel" or not hasattr(ready.liner, "speed_law"):
        with torch.no_grad():
            facts["level_error"] = max(
                interpolation_error(ready.liner, f, ready.grid) for f in ready.frequency.tolist()
            )
    return facts


def _goodrich(ready: Prepared) -> Tensor | None:
    """Linear liner plus eq. (2.7), (F,), where the plane states Mach number and delta*."""
    plane, porosity = ready.plane, getattr(ready.liner, "surface_porosity", None)
    diameter = getattr(ready.liner, "orifice_diameter", None)
    if not (plane.mach and plane.displacement_thickness and porosity and diameter is not None):
        return None
    added = goodrich_resistance(
        plane.mach, porosity, plane.displacement_thickness, plain_number(diameter)
    )
    with torch.no_grad():
        return impedance_of(ready.liner, ready.frequency, torch.zeros(1)) + added


def _assemble(
    ready: Prepared,
    phase: str,
    reflection: Tensor,
    held: Tensor,
    peak: Tensor,
    notes: list[str],
) -> ImpedanceMap:
    plane, cells, seen = ready.plane, ready.cells, ready.seen
    kept = ready.used.to(reflection.device)

    def on_probes(value: Tensor) -> Tensor:
        return value[: plane.probes].reshape((*plane.probe_shape, *value.shape[1:]))

    probes = reflection[: plane.probes]
    return ImpedanceMap(
        frequency=ready.frequency,
        reflection=on_probes(
            torch.where(kept[:, None], probes, torch.full_like(probes, torch.nan))
        ),
        mean_velocity=on_probes(seen.mean),
        velocity_rms=on_probes(seen.rms),
        velocity_amplitude=on_probes(peak),
        coherence=on_probes(seen.coherence),
        phase_rule=on_probes(held),
        cell_x=cells.x,
        cell_z=cells.z,
        cell_reflection=cells.average_reflection(probes, kept),
        cell_reflection_velocity_first=reflection[plane.probes :],
        x=plane.x,
        z=plane.z,
        height=plane.height,
        fluid=plane.fluid,
        reference=dict(plane.reference),
        mach=plane.mach,
        incident_level=plane.incident_level,
        source_side=plane.source_side,
        goodrich=_goodrich(ready),
        title=plane.title,
        choices=_facts(ready, phase),
        notes=tuple(notes),
    )
