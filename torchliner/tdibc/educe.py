"""DIR-TDIBC: impedance from wall-normal velocity, probe by probe, without a propagation model."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Any

from torchliner.checks import real_tensor, tell
from torchliner.io.moments_file import holds_moments
from torchliner.io.plane_join import named_planes
from torchliner.liners.model import Liner, LinerModel, as_liner
from torchliner.records import VelocityPlane
from torchliner.records.origin import origin_of, with_choices
from torchliner.reduction.moments import Moments
from torchliner.reduction.probe_velocity import with_smaller_slabs
from torchliner.reduction.sources import in_full_precision
from torchliner.replay.phase_rule import phase_rule
from torchliner.tdibc.broadband import educe_signal
from torchliner.tdibc.choices import Choices
from torchliner.tdibc.engines import tone_sums
from torchliner.tdibc.prepare import prepare
from torchliner.tdibc.prepared import Prepared, Progress
from torchliner.tdibc.replayed import Replayed
from torchliner.tdibc.requested import Request
from torchliner.tdibc.slices import moments_in_slices


@in_full_precision
def educe(
    plane: Any,
    liner: Liner,
    frequency: Any = None,
    *,
    reference_phase: Any = None,
    reflected: str | Path | None = None,
    pressure: Any = None,
    progress: Progress | None = None,
    client: Any = None,
    **choices: Any,
) -> Any:
    """Impedance map of a plane: a known wave replayed through a liner driven by |v(t)|.

    The educed reflection is the window-weighted mean of the liner model's own R(f, |v(t)|) (plus
    its 2 f line once a phase is stated): it is the response of YOUR model to YOUR velocity data.

    Args:
        plane: wall-normal velocity, (..., T) m/s, or the ``Moments`` of one; or several planes,
            which then share their functions of |v| and kernels, so that their maps can be compared
            to the last digit.
        liner: ``SDoFLiner``, ``TabulatedLiner`` or any object with ``impedance(frequency, speed)``.
        frequency: Hz, one or several; default the plane's own tone; with ``Tones`` these, with
            ``Sweep`` and ``BandNoise`` the lines of the segments in their band, 200 at most.
        reference_phase: psi in rad for ``phase="given"``: x(t) = cos(2 pi f t + psi) with t = 0 at
            the first sample; broadcast over the probe axes (add a last axis for several
            frequencies).
        reflected: file to write the reflected signal of every probe to (docs/formats.md); needs an
            incident signal.
        pressure: ``PressureRecord`` of the same run, or ``MicrophoneLine`` along the wall, that
            closure is checked with; default the ``incident_level`` that the plane states.
        progress: called with numbers of samples done, 2 T a plane in all.
        client: of dask.distributed, whose workers read the planes, as in ``moments``.
        choices: see ``torchliner.tdibc.choices.Choices``.
    Returns:
        The map, on the probe axes of the plane, with cell and liner averages in every order; a
        list of maps for several planes.
    Raises:
        ValueError: data or options that cannot give an answer; the message says what would.
        TypeError: a value of the wrong kind.
    Warns:
        DataWarning: the answer stands but is doubtful; the same text is in ``notes``.
    Source: Roncen et al. (2026), section 3. Departures: two-sided kernels, edge rules, phase rules
        and drives are named (docs/method.md), and the errors of kernel and levels are reported.

    >>> steady = torch.full((2, 900), 5.0, dtype=torch.float64)  # m/s, two probes
    >>> plane = tl.VelocityPlane(steady, sampling_rate=42e3, frequency=1400.0)
    >>> found = tl.educe(plane, tl.load_liner("polito"), interval=None)
    >>> f"{complex(found.liner_impedance[0]):.2f}"  # |v| never changes: the model's own value
    '4.61-0.27j'
    """
    several = isinstance(plane, (list, tuple))
    planes = list(plane) if several else [plane]
    for each in planes:
        if not isinstance(each, (VelocityPlane, Moments)):
            raise TypeError(f"plane is {type(each).__name__}; make a VelocityPlane of your data first")
    if not planes:
        raise ValueError("no plane is given")
    liner = as_liner(liner)
    chosen = Choices(**choices)
    _check_signal_output(chosen, reference_phase, reflected, len(planes))
    if client is not None:
        request = Request(liner, frequency, choices=choices)
        planes = [
            each if isinstance(each, Moments) else moments_in_slices(
                each, request, client=client, progress=progress)
            for each in planes
        ]  # fmt: skip
    origins = [_origin(each, liner, pressure, chosen, reference_phase) for each in planes]
    found = []
    for prepared, origin in zip(prepare(planes, liner, frequency, chosen, progress), origins, strict=True):
        if chosen.incident is not None:
            result = educe_signal(prepared, reflected, progress)
        else:
            result = replay(prepared, progress=progress).map(chosen.phase, reference_phase, pressure)
        tell(result.notes)
        found.append(with_choices(result, **origin))
    return found if several else found[0]


def _origin(
    plane: VelocityPlane | Moments, liner: LinerModel, pressure: Any, chosen: Choices, phase: Any
) -> dict[str, Any]:
    """What a map keeps so that it can be made again, beside its choices."""
    data: VelocityPlane = plane.plane if isinstance(plane, Moments) else plane
    named = named_planes(data)
    if isinstance(plane, Moments) and Path(data.name).is_file() and holds_moments(data.name):
        named = [("moments", data.name)]
    named += [("liner", name) for name in liner.files]
    named += [] if pressure is None else [("wall pressure", getattr(pressure, "name", ""))]
    named += [("incident signal", chosen.incident.label)] if chosen.incident is not None else []
    stated = None if phase is None else real_tensor(phase).tolist()
    return origin_of(named, reference_phase=stated)


def _check_signal_output(chosen: Choices, reference_phase: Any, reflected: Any, count: int) -> None:
    if chosen.incident is None and reflected is not None:
        raise ValueError(
            "a reflected signal needs an incident one; name it, e.g. incident='noise:300:3500' or Tones(1400.0)"
        )
    if reflected is not None and count > 1:
        raise ValueError("several planes would share one reflected file; educe them one by one")
    if chosen.incident is not None and reference_phase is not None:
        raise ValueError("reference_phase is for tones; an incident signal has its own phase")


def replay(prepared: Prepared, *, every_rule: bool = False, progress: Progress | None = None) -> Replayed:
    """R of all columns for tones, by the engine chosen; no reading of the data for ``spectral``.

    Args:
        prepared: of ``prepare``, with the same ``every_rule``.
        every_rule: keep what any phase rule can be read off; default what the chosen one needs.
        progress: called with numbers of samples done.
    """
    backward = every_rule or phase_rule(prepared.chosen.phase).needs_backward
    if prepared.chosen.engine == "spectral" or prepared.drive is None:
        return Replayed(prepared, prepared.line_sums)
    sums, notes = with_smaller_slabs(prepared.drive.velocity, lambda: tone_sums(prepared, backward, progress))
    return Replayed(dataclasses.replace(prepared, notes=(*prepared.notes, *notes)), sums)
