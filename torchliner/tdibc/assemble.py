"""A map from what a replay gave, with every choice that led to it."""

from __future__ import annotations

import dataclasses
from typing import Any

import torch
from torch import Tensor

from torchliner.conversions import admittance_from_reflection, reflection_from_admittance
from torchliner.liners.grazing import goodrich_resistance
from torchliner.liners.response import impedance_of
from torchliner.records import ImpedanceMap, Uncertainty
from torchliner.tdibc.prepared import Prepared
from torchliner.tdibc.tone_share import tone_share
from torchliner.version import __version__


def facts_of(prepared: Prepared, phase: str) -> dict[str, Any]:
    """Every choice, and what followed from it."""

    plane, chosen, kernels = prepared.plane, prepared.chosen, prepared.kernels
    segments = prepared.survey.segments
    facts: dict[str, Any] = {"version": __version__, **chosen.describe(), "phase": phase}
    facts["liner"] = prepared.liner.describe()
    facts |= {
        "velocity_max": prepared.grid.maximum,
        "coherence_segments": segments[0] if len(set(segments)) == 1 else list(segments),
        "sampling_rate": plane.sampling_rate,
        "samples": plane.samples,
        "source": plane.name,
        "tone": plane.frequency,
        "surface": plane.liner,
        "data": dict(plane.provenance),
    }
    if prepared.periodic is not None:
        part = prepared.periodic
        facts["coherent_lines"] = part.harmonics.lines.tolist()
        facts["coherent_share"] = part.share.mean(1).tolist()
        facts["tone_share"] = tone_share(prepared)
        facts["incoherent_scale"] = float(part.scale[prepared.in_cells.to(part.scale.device)].mean())
    if kernels is not None:
        facts["kernel_error"], facts["kernel_gain"] = kernels.error, kernels.gain
        facts["kernel_band"] = list(kernels.band)
    if prepared.reader is not None and chosen.engine == "spectral":
        facts["basis"] = prepared.reader.basis.describe()
        facts["model_error"] = prepared.model_error
        if prepared.drive is not None:
            facts["readings"] = prepared.readings
    return facts


def goodrich_of(prepared: Prepared) -> Tensor | None:
    """Linear liner plus eq. (2.7), (F,), where the plane states Mach number and delta*; what the
    liner's own law adds for the flow is taken off before."""
    plane, porosity = prepared.plane, prepared.liner.surface_porosity
    diameter = prepared.liner.hole_diameter
    if not (plane.mach and plane.displacement_thickness and porosity and diameter is not None):
        return None
    added = goodrich_resistance(plane.mach, porosity, plane.displacement_thickness, diameter)
    added = added - prepared.liner.flow_resistance
    with torch.no_grad():
        return impedance_of(prepared.liner, prepared.frequency, torch.zeros(1)) + added


def _admittance(reflection: Tensor, wall: Tensor | None) -> Tensor:
    found = admittance_from_reflection(reflection)
    return found if wall is None else torch.where(wall, 0, found)


def assemble(
    prepared: Prepared,
    phase: str,
    reflection: Tensor,
    held: Tensor,
    peak: Tensor,
    notes: list[str],
    uncertainty: Uncertainty | None = None,
    wall: Tensor | None = None,
) -> ImpedanceMap:
    """The map.

    Args:
        prepared: prepared plane.
        phase: rule that was used.
        reflection: R of all columns, (N, F), see ``Prepared``.
        held: whether the rule held there, (N, F).
        peak: complex peak amplitude of v into the liner, (N, F).
        notes: all warnings.
        uncertainty: intervals, of the probes as (P, F).
        wall: probes that count as wall in averages over probes, (P, F).
    """
    plane, cells, seen = prepared.plane, prepared.cells, prepared.survey
    kept = prepared.used.to(reflection.device)

    def on_probes(value: Tensor) -> Tensor:
        """The probes' part, on the plane's axes; nan where a probe was left out."""
        part = value[: plane.probes]
        if part.dtype != torch.bool:
            shape = (-1, *(1,) * (part.ndim - 1))
            nan = complex(float("nan"), float("nan")) if part.is_complex() else float("nan")
            part = torch.where(kept.reshape(shape), part, torch.tensor(nan, dtype=part.dtype, device=part.device))
        return part.reshape((*plane.probe_shape, *value.shape[1:]))

    probes = reflection[: plane.probes]
    known: dict[str, Any] = {}
    if prepared.periodic is not None:
        star, inside = reflection[-plane.probes :], prepared.in_cells.to(reflection.device)
        known = {
            "reflection_coherent_first": on_probes(star),
            "cell_reflection_coherent_first": cells.average_reflection(star, kept, wall),
            "liner_reflection_coherent_first": reflection_from_admittance(_admittance(star, wall)[inside].mean(0)),
        }
    if uncertainty is not None:
        uncertainty = dataclasses.replace(uncertainty, probes=uncertainty.probes.map(on_probes))
    return ImpedanceMap(
        frequency=prepared.frequency,
        reflection=on_probes(probes),
        mean_velocity=on_probes(seen.mean),
        velocity_rms=on_probes(seen.rms),
        velocity_amplitude=on_probes(peak),
        coherence=on_probes(seen.coherence),
        phase_rule=on_probes(held),
        cell_x=cells.x,
        cell_z=cells.z,
        cell_reflection=cells.average_reflection(probes, kept, wall),
        cell_reflection_velocity_first=reflection[prepared.averaged],
        x=plane.x,
        z=plane.z,
        height=plane.height,
        fluid=plane.fluid,
        reference=dict(plane.reference),
        mach=plane.mach,
        incident_level=plane.incident_level,
        source_side=plane.source_side,
        goodrich=goodrich_of(prepared),
        title=plane.title,
        choices=facts_of(prepared, phase),
        notes=tuple(notes),
        uncertainty=uncertainty,
        wall=None if wall is None else on_probes(wall),
        cell_weight=cells.weight,
        holes=plane.holes,
        **known,
    )
