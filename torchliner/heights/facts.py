"""What is known of the height of a plane besides its impedance: cell-periodic modulation, and the reach of jets."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import torch
from numpy.typing import ArrayLike
from torch import Tensor

from torchliner.checks import DataWarning, plain_number
from torchliner.duct.flow_profiles import Array, TanhProfile
from torchliner.heights.jets import jet_velocity, penetration_height
from torchliner.liners.model import LinerModel
from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.velocity.reading import time_moments

FEWEST_PROBES = 4  # to a cell
MOST_HARMONICS = 8
WHOLE = 0.01  # of a cell, by which probes may miss a whole number of cells
FEWEST_HEIGHTS = 3  # for a decay law
MOST_SCATTER = 1.3


@dataclass(frozen=True)
class Imprint:
    """Harmonics of the cell pitch in a profile along x.

    Args:
        mean: of the profile over whole cells, m/s.
        harmonics: peak amplitude of harmonics 1, 2, ... of the pitch, m/s.
        between: rms of the waves half way between them (1 1/2, 2 1/2, ... to a cell), m/s, which
            nothing periodic in the cell can have: what scatter alone gives. None for one cell.
        cells: whole cells behind it.
    """

    mean: float
    harmonics: tuple[float, ...]
    between: float | None
    cells: int

    @property
    def rms(self) -> float:
        """Of the cell-periodic part, m/s."""
        return math.sqrt(sum(h**2 for h in self.harmonics) / 2)

    @property
    def relative(self) -> float:
        """rms of the cell-periodic part over the mean of the profile."""
        return self.rms / self.mean if self.mean > 0 else math.nan

    @property
    def first(self) -> float:
        """Peak amplitude of the first harmonic, m/s."""
        return self.harmonics[0]


def cell_imprint(x: ArrayLike, values: ArrayLike, pitch: float) -> Imprint:
    """Cell-periodic part of a profile along x.

    Harmonics rather than the profile folded into one cell: they need no probe to sit at the same
    place of every cell, do not grow with the number of probes a cell, and each has its own decay
    with height. They are fitted by least squares over whole cells, together with a mean and, from
    two cells on, a linear growth along x and the waves between the harmonics; on whole cells with
    even probes and no growth this is the discrete Fourier sum.

    Args:
        x: m, evenly rising, (N,).  values: m/s, (N,).  pitch: L_c, m.
    Raises:
        ValueError: the probes span no whole cell, or fewer than four of them stand in one (with
            several cells more than four are needed, for the waves between the harmonics).
    """
    places, profile = np.asarray(x, np.float64), np.asarray(values, np.float64)
    spacing = float(np.diff(places).mean())
    cells = math.floor(len(places) * spacing / pitch + WHOLE)
    if cells < 1:
        raise ValueError(
            f"the probes span {1e3 * len(places) * spacing:.4g} mm, less than one cell of {1e3 * pitch:.4g} mm"
        )
    most = math.ceil(pitch / (2 * spacing)) - (1 if cells == 1 else 2)
    if most < 1 or pitch / spacing < FEWEST_PROBES - 1e-6:
        raise ValueError(
            f"{pitch / spacing:.3g} probes to a cell of {1e3 * pitch:.4g} mm do not resolve it; "
            f"at least {FEWEST_PROBES} are needed, with several cells more than that"
        )
    inside = places - places[0] < cells * pitch - (0.5 - WHOLE) * spacing
    phase, profile = (places[inside] - places[0]) / pitch, profile[inside]
    orders = np.arange(1.0, min(MOST_HARMONICS, most) + 0.5, dtype=np.float64)
    growth = [phase - phase.mean()] if cells > 1 else []
    columns = [np.ones_like(phase), *growth, *_waves(phase, orders)]
    if cells > 1:
        columns += _waves(phase, np.asarray(orders + 0.5))
    found, *_ = np.linalg.lstsq(np.stack(columns, 1), profile, rcond=None)
    parts = found[1 + len(growth) :].reshape(-1, 2)
    sizes = np.hypot(parts[:, 0], parts[:, 1])
    count = len(orders)
    between = float(np.sqrt((sizes[count:] ** 2).sum() / 2)) if cells > 1 else None
    return Imprint(float(found[0]), tuple(float(s) for s in sizes[:count]), between, cells)


def _waves(phase: Array, orders: Array) -> list[Array]:
    turns = 2 * np.pi * phase
    return [part(m * turns) for m in orders for part in (np.cos, np.sin)]


@dataclass(frozen=True)
class Decay:
    """a exp(-y/l) fitted to an amplitude over height.

    Args:
        amplitude: a, at y = 0.  rate: 1/l, 1/m; negative where the amplitude grows with height.
        evanescent: L_c/(2 pi), m, the length of the first harmonic of a sound field whose
            wavelength is far above the pitch.
        scatter: factor by which the heights stray from the fit, rms; 1 for a perfect one.
    """

    amplitude: float
    rate: float
    evanescent: float
    scatter: float

    @property
    def follows(self) -> bool:
        """Whether the amplitude falls, and strays from the fit by less than a factor 1.3."""
        return self.rate > 0 and self.scatter <= MOST_SCATTER

    @property
    def length(self) -> float:
        """l, m; negative where the amplitude grows."""
        return 1 / self.rate if self.rate else math.inf

    def at(self, height: ArrayLike) -> Array:
        """The fitted amplitude at a height, m."""
        return self.amplitude * np.exp(-self.rate * np.asarray(height, np.float64))


def fit_decay(heights: Sequence[float], amplitudes: Sequence[float], pitch: float) -> Decay | None:
    """Least squares of ln(amplitude) over height, m, (N,) both; None with fewer than three heights
    or an amplitude not above 0. ``pitch`` is L_c, m."""
    if len(heights) < FEWEST_HEIGHTS or not all(a > 0 for a in amplitudes):
        return None
    places, logs = np.asarray(heights), np.log(amplitudes)
    slope, start = np.polyfit(places, logs, 1)
    stray = float(np.sqrt(np.mean((logs - slope * places - start) ** 2)))
    return Decay(math.exp(float(start)), -float(slope), pitch / (2 * math.pi), scatter=math.exp(stray))


@dataclass(frozen=True)
class JetFlow:
    """The mean flow that the jets of appendix A.2 stand in; the paper's values of figure 22.

    Args:
        duct_height: H, m.  shear: of ``TanhProfile``.
    Raises:
        ValueError: see ``TanhProfile``.
    """

    duct_height: float = 50e-3
    shear: float = 0.05

    def __post_init__(self) -> None:
        self.profile(0.1, 343.2)

    def profile(self, mach: float, sound_speed: float) -> TanhProfile:
        """The profile at a bulk Mach number."""
        return TanhProfile(mach, self.duct_height, self.shear, sound_speed)


@dataclass(frozen=True)
class HeightFacts:
    """One plane: what does not hang on the averaging length.

    Args:
        height: m.  coherence: squared, of v with the tone, median over probes.
        velocity_rms: v', m/s, over the plane.
        imprint, mean_imprint, streamwise_imprint: of v'_rms, v_0 and u'_rms along x; None without
            a whole cell (or without u).
        jet_velocity, jet_height: m/s and m, eqs (A3) and (A2), with |Z| in the averaging of the answer; None where
            something is unknown.
        impedance: Z of the whole plane by averaging.
        level_check: level of the incident wave that Z and velocity imply over the one that is known, dB, by averaging;
            empty where it was not checked.
        level_limit: dB.
    """

    height: float
    coherence: float
    velocity_rms: float
    imprint: Imprint | None
    mean_imprint: Imprint | None
    streamwise_imprint: Imprint | None
    jet_velocity: float | None
    jet_height: float | None
    impedance: Mapping[str, complex]
    level_check: Mapping[str, float]
    level_limit: float


def facts_of_plane(
    plane: VelocityPlane, seen: ImpedanceMap, liner: LinerModel, pitch: float | None, flow: JetFlow
) -> tuple[HeightFacts, list[str]]:
    """The facts of a plane, and what could not be found out and why.

    Args:
        plane: with coordinates and a height.  seen: its map, at one frequency.
        liner: whose ``surface_porosity`` and ``hole_diameter`` are used, if it has holes.
        pitch: L_c, m, or None.  flow: for the jets.
    """
    assert plane.height is not None
    rms = seen.velocity_rms.detach().cpu()
    (waves, steady, stream), notes = _imprints(plane, rms, seen.mean_velocity.detach().cpu(), pitch)
    speed, reach, reason = _jet(plane, complex(seen.answer[0]), liner, flow)
    facts = HeightFacts(
        height=plane.height,
        coherence=float(seen.coherence[..., 0].nanmedian()),
        velocity_rms=float((rms**2).nanmean().sqrt()),
        imprint=waves,
        mean_imprint=steady,
        streamwise_imprint=stream,
        jet_velocity=speed,
        jet_height=reach,
        impedance={name: complex(each.impedance[0]) for name, each in seen.liner.items()},
        level_check=_level_checks(seen),
        level_limit=math.nan if seen.level_check is None else seen.level_check.limit,
    )
    return facts, notes if reason is None else [*notes, f"no jet height: {reason}"]


def _level_checks(seen: ImpedanceMap) -> dict[str, float]:
    """dB by averaging."""
    if seen.level_check is None:
        return {}
    levels = zip(seen.level_check.averagings, seen.level_check.liner.level[:, 0].tolist(), strict=True)
    return {averaging: level for averaging, level in levels if math.isfinite(level)}


def _imprints(
    plane: VelocityPlane, rms: Tensor, mean: Tensor, pitch: float | None
) -> tuple[list[Imprint | None], list[str]]:
    if pitch is None:
        return [None, None, None], ["no cell pitch is known; the cell-periodic modulation cannot be judged"]
    profiles: list[Array | None] = [_over_z(rms**2) ** 0.5, _over_z(mean), None]
    if plane.streamwise is not None:
        name = f"{plane.name}, streamwise"
        stream = VelocityPlane(plane.streamwise, sampling_rate=plane.sampling_rate, name=name)
        mean_stream, square = time_moments(stream)
        variance = (square - mean_stream**2).clamp(min=0)
        profiles[2] = _over_z(variance.reshape(plane.probe_shape)) ** 0.5
    try:
        found = [None if p is None else cell_imprint(plane.x, p, pitch) for p in profiles]
    except ValueError as error:
        return [None, None, None], [f"{plane.name}: no cell-periodic modulation can be judged: {error}"]
    alone = found[0] is not None and found[0].cells == 1
    note = (
        "the probes span a single cell: the cell-periodic modulation is the harmonics of the pitch in it, and nothing "
        "shows that they repeat"
    )
    return found, [note] if alone else []


def _over_z(values: Tensor) -> Array:
    """Mean over z of (z, x); (x) as it is."""
    return values.reshape(-1, values.shape[-1]).nanmean(0).to(torch.float64).numpy()


def _jet(
    plane: VelocityPlane, impedance: complex, liner: LinerModel, flow: JetFlow
) -> tuple[float | None, float | None, str | None]:
    """U_j, H_j, and why one of them is not known."""
    if plane.liner == "hard wall":
        return None, None, "there are no holes in a hard wall"
    level, mach = plane.incident_level, plane.mach
    porosity, diameter = liner.surface_porosity, liner.hole_diameter
    stated = {"level of the sound": level, "Mach number": mach, "porosity": porosity,
              "hole diameter": diameter}  # fmt: skip
    if level is None or mach is None or porosity is None or diameter is None:
        lacking = [name for name, value in stated.items() if value is None]
        return None, None, f"{' and '.join(lacking)} not stated"
    if not 0 < abs(impedance) < float("inf"):
        return None, None, f"the impedance is {impedance}"
    speed = jet_velocity(level, plain_number(porosity), impedance, plane.fluid)
    if not mach:
        return speed, None, "without a mean flow A.2 sets no limit to a jet"
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DataWarning)  # of a thin shear layer: JetFlow has warned
        profile = flow.profile(mach, float(plane.fluid.sound_speed))
    try:
        return speed, float(penetration_height(speed, diameter, profile)), None
    except ValueError as error:
        return speed, None, str(error)
