"""Moments of a plane, from which any liner's impedance follows without the data."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from torchliner.io.plane_join import named_planes
from torchliner.liners.model import Liner
from torchliner.records import VelocityPlane
from torchliner.records.origin import origin_of
from torchliner.reduction.moments import Moments
from torchliner.tdibc.prepared import Progress
from torchliner.tdibc.requested import Request
from torchliner.tdibc.slices import moments_in_slices, reduce_whole


def moments(
    plane: VelocityPlane,
    liner: Liner | None = None,
    frequency: Any = None,
    *,
    cell_pitch: float | None = None,
    progress: Progress | None = None,
    client: Any = None,
    **choices: Any,
) -> Moments:
    """Sums over a plane that hold R(f, |v|) of any liner at any frequency.

    Args:
        plane: wall-normal velocity, (..., T) m/s.
        liner: for which K and c are chosen, and whose cells are averaged over; default any: K = 64,
            c = 1.5 m/s, which know R of holes of 0.5 to 2.5 mm in 3 to 15 % open area to 1e-5 up to
            6 kHz; the result of each eduction states the error.
        frequency: Hz, at which a phase rule other than ``averaged`` or a window is to be read, and
            for K and c; default the plane's own tone.
        cell_pitch: L_c, m, without a liner.
        progress: called with numbers of samples done, 2 T in all.
        client: of dask.distributed, whose workers read the plane by slices; it must still be in
            its file (``read_plane(file, lazy=True)``). The same bits whatever the workers.
        choices: as for ``educe``: what concerns |v| (``drive``, ``mean``, ``order``, ...) and the
            rows that are kept (``phase``, ``window``); the rest is chosen when Z is asked for.
    Raises:
        TypeError: plane is no VelocityPlane.
        ValueError: data or options that cannot give an answer.
    """
    request = Request(liner, frequency, cell_pitch, choices)
    if isinstance(plane, VelocityPlane) and (inputs := origin_of(named_planes(plane))["inputs"]):
        plane = replace(plane, provenance={**plane.provenance, "inputs": inputs})
    if client is not None:
        return moments_in_slices(plane, request, client=client, progress=progress)
    return reduce_whole(plane, request, progress)
