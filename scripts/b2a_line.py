"""The five configurations of table 2 as bursts that one can have: the chain of figures 9 to 12.

    python scripts/b2a_line.py [-o FOLDER] [--stations 120] [--seconds 10] [--phase averaged]

No line of laser Doppler data above a liner is public. This writes files of bursts as they would be
measured if the assumptions below held (``assumptions``: they stand on every figure) and runs
``educe_bursts`` on the files. What follows tests the chain, and how much of the paper's trends
these assumptions contain; it is no measurement.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
import torch
from scipy.special import j1

import torchliner as tl
from common import DATA, FIGURES, options_of, parser_of
from studies.station_line_figures import draw_averages, draw_line_velocity
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.duct.dispersion import wavenumber_from_impedance
from torchliner.io.csv_rows import write_rows
from torchliner.report.bursts import draw_lines
from torchliner.report.figure import STYLE, finish

FREQUENCY, LENGTH, HEIGHT = 1500.0, 0.150, 0.050  # Hz; of the liner, of the duct, m
RATE, VALIDATED, FINE = 15e3, 0.97, 200e3  # bursts a second, share of them, Hz of the simulation
FRICTION = {0.3: 4.2, 0.1: 4.2 * 3 ** (-7 / 8)}  # m/s
V_PLUS = 1.10  # v'/u_tau at y/h = 0.04 to 0.1
SOURCE_PLANE, SOURCE_FRICTION = DATA / "channel_y2.44mm.h5", 5.52  # m/s
DISPLACEMENT = 2.0e-3  # m, the paper's
HOLE_SPACING = 3.31e-3  # m, table 1; eight holes, taken as a 3 x 3 grid without its centre
GROWTH = 0.35  # of v' along the liner in the lines "growing"
PAPER = {"4": 2.33 - 0.30j, "5": 2.25 - 0.30j}


@dataclass(frozen=True)
class Case:
    """A configuration of table 2, and the height of its line."""

    name: str
    mach: float
    level: float
    side: str
    height: float = 1.0e-3
    growth: float = 0.0


CASES = (
    Case("1", 0.1, 115.0, "upstream"),
    Case("2", 0.1, 130.0, "upstream"),
    Case("3", 0.1, 145.0, "upstream"),
    Case("4", 0.3, 145.0, "upstream"),
    Case("5", 0.3, 145.0, "downstream"),
)
HIGH = Case("3, 2.5 mm", 0.1, 145.0, "upstream", height=2.5e-3)
GROWING = tuple(replace(case, name=f"{case.name} growing", growth=GROWTH) for case in CASES[3:])


def assumptions(seconds: float) -> str:
    """What is assumed, in words."""
    return (
        f"SIMULATED bursts ({seconds:g} s, Poisson, {RATE / 1e3:g} kHz after {100 * VALIDATED:g} % "
        "validation). Assumed: Gaussian turbulence, alike along x,\n"
        f"spectrum of a channel LES scaled with $y/u_\\tau$, $v'$ = {V_PLUS:g} $u_\\tau$, "
        f"$u_\\tau$ = {FRICTION[0.3]:g} m/s at Mach 0.3 and {FRICTION[0.1]:.2f} at 0.1; no steady "
        "$v_0$; one incident wave\ndecaying by the lined duct's mode (uniform flow, Ingard-Myers); "
        "$v = p/(\\rho c Z)$, spread over a 3 x 3 grid of holes\n"
        f"({1e3 * HOLE_SPACING:.3g} mm apart, none in the middle) by potential flow up to the "
        "height $y$."
    )


class Turbulence:
    """Gaussian noise with the spectrum of v in a plane of the channel simulation."""

    def __init__(self) -> None:
        plane = tl.read_plane(SOURCE_PLANE)
        values = plane.velocity.reshape(-1, plane.samples).to(torch.float64)
        values = values - values.mean(1, keepdim=True)
        window = torch.hann_window(plane.samples, dtype=torch.float64)
        power = torch.fft.rfft(values * window).abs().square().mean(0).numpy()
        self.frequency = np.fft.rfftfreq(plane.samples, 1 / plane.sampling_rate)
        power[0] = power[1]  # the mean was taken off
        self.power = power
        assert plane.height is not None
        self.pace = SOURCE_FRICTION / plane.height  # 1/s

    def at(self, times: np.ndarray, pace: float, rms: float, seed: int) -> np.ndarray:
        """v at times, m/s, from a record of ``FINE`` Hz; ``pace`` is u_tau/y, 1/s."""
        generator = np.random.default_rng(seed)
        samples = math.ceil(times[-1] * FINE) + 2
        frequency = np.fft.rfftfreq(samples, 1 / FINE)
        scaled = frequency * self.pace / pace
        amplitude = np.sqrt(np.interp(scaled, self.frequency, self.power, right=0.0))
        white = generator.standard_normal((len(frequency), 2)) @ np.array([1, 1j])
        values = np.fft.irfft(white * amplitude, n=samples)
        return np.asarray(rms / values.std() * values[np.rint(times * FINE).astype(int)])


def imprint(x: np.ndarray, height: float, pitch: float, diameter: float) -> np.ndarray:
    """Velocity over its mean along the middle row of holes of a cell, at a height: potential flow
    above pistons, sum over the harmonics k of the cell of c_k e^{-ky}."""
    offsets = HOLE_SPACING * np.array([-1.0, 0.0, 1.0])
    holes = np.array([(a, b) for a in offsets for b in offsets if (a, b) != (0.0, 0.0)])
    orders = np.arange(-40, 41)
    waves = 2 * np.pi / pitch * np.stack(np.meshgrid(orders, orders, indexing="ij"), -1)
    k = np.hypot(waves[..., 0], waves[..., 1])
    k[40, 40] = 1.0  # the mean, whose term is 1
    size = 2 * j1(k * diameter / 2) / (k * diameter / 2) * np.exp(-k * height)
    share = np.exp(-1j * waves @ holes.T).mean(-1) * size
    share[40, 40] = 1.0
    along = np.exp(1j * np.outer(x - pitch / 2, waves[:, 0, 0]))
    return np.real(along @ share.sum(1))


def settled_impedance(liner: Any, rms: float, pressure: float, ratio: float) -> complex:
    """Z of the model at the velocity that it lets in itself: Gaussian turbulence plus the tone."""
    turbulent = torch.linspace(-5, 5, 201, dtype=torch.float64)
    weight = torch.exp(-(turbulent**2) / 2)
    phase = torch.arange(24, dtype=torch.float64) * 2 * torch.pi / 24
    z = complex(1.5, -0.3)
    for _ in range(60):
        peak = ratio * pressure / (tl.Fluid().characteristic_impedance * abs(z))
        speed = (rms * turbulent[:, None] + peak * torch.cos(phase)).abs()
        reflection = tl.reflection_from_impedance(liner.impedance(FREQUENCY, speed))
        mean = (weight[:, None] * reflection).sum() / (weight.sum() * len(phase))
        z = 0.5 * z + 0.5 * complex(tl.impedance_from_reflection(mean))
    return z


@dataclass(frozen=True)
class Sound:
    """The tone of a configuration.

    Args:
        impedance: of the liner, as the bursts are made with.
        wavenumber: of the lined duct, 1/m.
        incident: peak pressure where the wave meets the liner, Pa.
        start: x there, m.
    """

    impedance: complex
    wavenumber: complex
    incident: float
    start: float

    @classmethod
    def of(cls, case: Case, liner: Any) -> Sound:
        """From level, flow and source side."""
        incident = pressure_amplitude_from_spl(case.level)
        z = settled_impedance(liner, V_PLUS * FRICTION[case.mach], incident, 1.0)
        direction = {"upstream": "downstream", "downstream": "upstream"}[case.side]
        alpha = complex(
            wavenumber_from_impedance(
                torch.tensor(z),
                FREQUENCY,
                height=HEIGHT,
                mach=case.mach,
                direction=direction,
                sound_speed=tl.Fluid().sound_speed,
            )
        )
        return cls(z, alpha, incident, 0.0 if case.side == "upstream" else LENGTH)

    def velocity(self, x: np.ndarray) -> np.ndarray:
        """Into the liner, homogeneous over a cell, complex peak, m/s."""
        pressure = self.incident * np.exp(-1j * self.wavenumber * (x - self.start))
        return np.asarray(pressure / (tl.Fluid().characteristic_impedance * self.impedance))

    def facts(self) -> dict[str, float]:
        """For the table."""
        decay = 20 * math.log10(math.e) * abs(self.wavenumber.imag) * LENGTH
        return {
            "assumed resistance": self.impedance.real,
            "assumed reactance": self.impedance.imag,
            "decay (dB)": decay,
        }


def write_case(case: Case, liner: Any, turbulence: Turbulence, folder: Path, stations: int, seconds: float) -> None:
    """Files of bursts of one configuration."""
    friction = FRICTION[case.mach]
    places = (np.arange(stations) + 0.5) * LENGTH / stations
    velocity = Sound.of(case, liner).velocity(places)
    velocity = velocity * imprint(places, case.height, liner.cell_pitch, liner.orifice_diameter)
    for i, (x, amplitude) in enumerate(zip(places, velocity, strict=True)):
        seed = int(1e5 * case.mach) + 1000 * round(case.level) + 7919 * i + len(case.side)
        generator = np.random.default_rng(seed)
        count = int(1.01 * RATE / VALIDATED * seconds) + 500
        times = np.cumsum(generator.exponential(VALIDATED / RATE, count))
        times = times[times < seconds]
        rms = V_PLUS * friction * (1 + case.growth * x / LENGTH)
        values = turbulence.at(times, friction / case.height, rms, seed + 1)
        # Into the liner is -v.
        values -= np.abs(amplitude) * np.cos(2 * np.pi * FREQUENCY * times + np.angle(amplitude))
        valid = generator.random(len(times)) < VALIDATED
        record = tl.BurstRecord(
            times[valid],
            wall_normal=values[valid],
            x=float(x),
            y=case.height,
            z=6.34e-3,
            frequency=FREQUENCY,
            mach=case.mach,
            incident_level=case.level,
            source_side=case.side,
            displacement_thickness=DISPLACEMENT,
            liner="onera",
            title=f"x{1e3 * x:.1f}",
            provenance={"simulated": assumptions(seconds)},
        )
        record.write(folder / f"station_{i:03d}.h5")


def slope(line: tl.ImpedanceLine, part: str) -> float:
    """Rise over the liner's length by a straight line."""
    values = getattr(line.impedance[:, 0], part).numpy()
    return float(np.polyfit(line.x.numpy(), values, 1)[0] * LENGTH)


def summary(case: Case, line: tl.ImpedanceLine, made: dict[str, float]) -> dict[str, Any]:
    """Numbers of a configuration."""
    found = line.average
    assert found is not None
    assert found.interval is not None
    assert line.goodrich is not None
    row: dict[str, Any] = {
        "configuration": case.name,
        "Mach": case.mach,
        "SPL (dB)": case.level,
        "source": case.side,
        "height (mm)": 1e3 * case.height,
    }
    for part, word in (("real", "resistance"), ("imag", "reactance")):
        row[word] = float(getattr(found.impedance[0], part))
        row[f"{word} low"] = float(getattr(found.interval.low[0], part))
        row[f"{word} high"] = float(getattr(found.interval.high[0], part))
        row[f"{word} spread of draws"] = float(getattr(found.monte_carlo_spread[0], part))
        row[f"{word} spread along x"] = float(getattr(found.spatial_spread[0], part))
        row[f"{word} rise along x"] = slope(line, part)
        row[f"{word} of the paper"] = getattr(PAPER.get(case.name, complex("nan")), part)
    row["v rms (m/s)"] = float(line.velocity_rms.mean())
    row["v tone peak (m/s)"] = float(line.velocity_level.mean())
    row["attenuation"] = float(line.attenuation.abs().mean())
    row["Goodrich resistance"] = float(line.goodrich[0].real)
    return row | made


def with_assumptions(figure: Any, caption: str, seconds: float, path: Path) -> None:
    """The picture, its caption with the assumptions."""
    with matplotlib.rc_context(fname=STYLE):
        finish(figure, path, f"{caption}; {assumptions(seconds)}")


def draw(lines: dict[str, tl.ImpedanceLine], folder: Path, seconds: float) -> None:
    """Figures 9 to 12."""
    main = [lines[case.name] for case in CASES]
    labels = [f"{c.name}: Mach {c.mach:g}, {c.level:g} dB, {c.side}" for c in CASES]
    with_assumptions(
        draw_line_velocity(main, labels=labels), "wall-normal velocity, y = 1 mm", seconds, folder / "b2a_velocity.png"
    )
    with_assumptions(
        draw_lines(main, labels=labels), "liner onera, 1500 Hz, y = 1 mm", seconds, folder / "b2a_impedance.png"
    )
    heights = draw_lines([lines["3"], lines[HIGH.name]], labels=["y = 1 mm", "y = 2.5 mm"])
    with_assumptions(heights, "configuration 3 at two heights", seconds, folder / "b2a_heights.png")
    names = [case.name for case in (*CASES[:3], HIGH, *CASES[3:])]
    averages = draw_averages(
        [lines[name] for name in names],
        labels=[name.replace(", ", "\n") for name in names],
        references=[PAPER.get(name) for name in names],
    )
    with_assumptions(averages, "admittance averages (5.2) by configuration", seconds, folder / "b2a_averages.png")


def report(rows: dict[str, dict[str, Any]]) -> None:
    """The numbers beside the paper's trends."""
    for name, row in rows.items():
        print(
            f"{name:10s} Z {row['resistance']:.3f}{row['reactance']:+.3f}j  interval R "
            f"{row['resistance low']:.4f} to {row['resistance high']:.4f}  along x R "
            f"{row['resistance rise along x']:+.3f} X {row['reactance rise along x']:+.3f}  v' "
            f"{row['v rms (m/s)']:.2f} m/s  decay {row['decay (dB)']:.1f} dB"
        )
    porosity, diameter = 0.0395, 0.991e-3
    added = [tl.goodrich_resistance(m, porosity, DISPLACEMENT, diameter) for m in (0.1, 0.3)]
    print(
        f"from configuration 3 to 4: R {rows['4']['resistance'] - rows['3']['resistance']:+.3f}, "
        f"Goodrich {added[1] - added[0]:+.3f}, the paper 0.94 to 1.12"
    )


def station_rows(line: tl.ImpedanceLine) -> list[dict[str, float]]:
    """What the figures show of each station, in six digits."""
    columns: dict[str, torch.Tensor] = {"x (m)": line.x}
    for part, word in (("real", "resistance"), ("imag", "reactance")):
        columns[word] = getattr(line.impedance, part)
        if line.interval is not None:
            columns |= {f"{word} {end}": getattr(getattr(line.interval, end), part) for end in ("low", "high")}
        columns[f"{word} spread over segments"] = getattr(line.segment_spread, part)
    columns |= {
        "mean velocity (m/s)": line.mean_velocity,
        "velocity rms (m/s)": line.velocity_rms,
        "coherent velocity peak (m/s)": line.velocity_level,
        "coherence": line.coherence,
        "inferred incident level (dB)": line.inferred_incident_level,
        "attenuation": line.attenuation.abs(),
        "rate (1/s)": line.rate,
    }
    if line.level_check is not None:
        columns["level check (dB)"] = line.level_check.cells.level[0]
    rounded = [[float(f"{value:.6g}") for value in each.flatten().tolist()] for each in columns.values()]
    return [dict(zip(columns, row, strict=True)) for row in zip(*rounded, strict=True)]


def _line(case: Case, liner: Any, turbulence: Turbulence, options: argparse.Namespace) -> tl.ImpedanceLine:
    """Simulated and educed, or as kept by an earlier run."""
    kept = None if options.lines is None else options.lines / f"{case.name.replace(' ', '_')}.h5"
    if kept is not None and kept.exists():
        return tl.read_line(kept)
    with tempfile.TemporaryDirectory() as place:
        write_case(case, liner, turbulence, Path(place), options.stations, options.seconds)
        began = time.perf_counter()
        line = tl.educe_bursts(place, liner, phase=options.phase)
        took = time.perf_counter() - began
    print(f"{case.name}: {options.stations} stations, {took / options.stations:.2f} s each", flush=True)
    if kept is not None:
        line.write(kept)
    return line


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("--stations", type=int, default=120)
    parser.add_argument("--seconds", type=float, default=10.0)
    parser.add_argument("--phase", choices=["averaged", "self-consistent"], default="averaged")
    parser.add_argument(
        "--lines",
        type=Path,
        metavar="FOLDER",
        help="keep educed lines there, and take those that are there, for other figures of them",
    )
    options = options_of(parser, arguments)
    if options.seconds < 2.6:
        parser.error("--seconds is too short for intervals; four segments of 1 s take 2.5 s")
    liner, turbulence = tl.load_liner("onera"), Turbulence()
    lines, rows, stations = {}, {}, []
    for case in (*CASES, HIGH, *GROWING):
        line = _line(case, liner, turbulence, options)
        lines[case.name] = line
        rows[case.name] = summary(case, line, Sound.of(case, liner).facts())
        stations += [{"configuration": case.name, **row} for row in station_rows(line)]
    report(rows)
    write_rows(list(rows.values()), options.output / "b2a_averages.csv")
    write_rows(stations, options.output / "b2a_stations.csv")
    draw(lines, options.output, options.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
