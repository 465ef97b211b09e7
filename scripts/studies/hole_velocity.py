r"""The velocity through the facesheet over time, from the pressure at the bottom of its cavities.

``cavity_mouth`` has rho c v_in = j phi_c sin(kH) p_b at one frequency. j sin(kH) is half a step
ahead less half a step back by tau = H/c, so without losses

.. math:: \rho c\,v_{in}(t) = \tfrac12\varphi_c\,[\,p_b(t + \tau) - p_b(t - \tau)\,]

at every frequency at once: the wave that will leave the bottom upwards less the one that came.
This is the velocity through the holes times their share of the surface, turbulence in it included,
and nothing that passes above the liner.
"""

from __future__ import annotations

import numpy as np

from torchliner.records import PressureRecord, VelocityPlane
from torchliner.records.cells import sort_into_cells


def hole_velocity(record: PressureRecord) -> VelocityPlane:
    """Velocity through the facesheet, averaged over the surface of each cell.

    Args:
        record: pressure at the bottom of the cavities, their depth and share of the surface.
    Returns:
        A plane with a probe per cavity, v positive away from the liner; shorter than the record by
        tau = H/c at both ends. Divided by the porosity it is the mean velocity in the holes.
    Raises:
        ValueError: no backplate pressure or no depth, or a record not longer than 2 tau.
    Source: d'Alembert's solution in the cavity; plane waves, no losses, a rigid bottom. Samples
        between those of the record by cubic splines.
    """
    from scipy.interpolate import CubicSpline

    if record.backplate is None or record.cavity_depth is None:
        missing = "cavity_depth" if record.backplate is not None else "backplate pressure"
        raise ValueError(f"{record.name}: {missing} is missing; the velocity is derived from it")
    pressure = record.backplate.detach().cpu().numpy().astype(np.float64)
    pressure = pressure.reshape(-1, pressure.shape[-1])
    delay = record.cavity_depth / record.fluid.sound_speed * record.sampling_rate
    first = int(np.ceil(delay - 1e-9))
    kept = np.arange(first, pressure.shape[-1] - first)
    if len(kept) < 2:
        raise ValueError(
            f"{record.name} holds {pressure.shape[-1]} samples; sound takes {delay:.3g} from the "
            "mouth to the bottom of the cavity, and twice that and 2 more are needed"
        )
    spline = CubicSpline(np.arange(pressure.shape[-1]), pressure, axis=-1)
    difference = spline(kept + delay) - spline(kept - delay)
    into = record.cavity_porosity * difference / (2 * record.fluid.characteristic_impedance)
    cells = sort_into_cells(record, record.cell_pitch)
    known = cells.count == len(into) and bool(np.isfinite(cells.x.numpy()).all())
    return VelocityPlane(
        -into,
        sampling_rate=record.sampling_rate,
        x=cells.x if known else None,
        fluid=record.fluid,
        frequency=record.frequency,
        incident_level=record.incident_level,
        mach=record.mach,
        source_side="unknown",
        reference=dict(record.reference),
        title=f"{record.title or record.name}: velocity through the facesheet",
        provenance={**record.provenance, "derived": "from the pressure at the cavity bottom"},
        name=record.name,
    )
