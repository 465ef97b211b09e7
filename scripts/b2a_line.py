"""The five configurations of table 2 as bursts that one can have: the chain of figures 10 to 12.

    python scripts/b2a_line.py [-o FOLDER] [--stations 120] [--seconds 10]

No line of laser Doppler data above a liner is public. This writes files of bursts as they would be measured if the
assumptions below held (``assumptions``: they stand on every figure) and runs ``educe_bursts`` on the files. What
follows tests the chain, and how much of the paper's trends these assumptions contain; it is no measurement.
"""

import math
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import torch
from scipy.special import j1

import torchliner as tl
from common import DATA, FIGURES, options_of, parser_of
from torchliner.conversions import pressure_amplitude_from_spl
from torchliner.duct.dispersion import wavenumber_from_impedance
from torchliner.io.result_writers import write_rows
from torchliner.report import figure as fig
from torchliner.report.fields import WIDTHS_OF_SEGMENTS, draw_lines
from torchliner.report.table import format_complex

FREQUENCY, LENGTH, HEIGHT = 1500.0, 0.150, 0.050  # Hz; of the liner, of the duct, m
RATE, VALIDATED, FINE = 15e3, 0.97, 200e3  # bursts a second, share of them, Hz of the simulation
FRICTION = {0.3: 4.2, 0.1: 4.2 * 3 ** (-7 / 8)}  # m/s
V_PLUS = 1.10  # v'/u_tau at y/h = 0.04 to 0.1
SOURCE_PLANE, SOURCE_FRICTION = DATA / "channel_y2.44mm.h5", 5.52  # m/s
DISPLACEMENT = 2.0e-3  # m, the paper's
HOLE_SPACING = 3.31e-3  # m, table 1; eight holes, taken as a 3 x 3 grid without its centre
GROWTH = 0.35  # of v' along the liner in the lines "growing"
PAPER = {"4": 2.33 - 0.30j, "5": 2.25 - 0.30j}
SHIFT = 0.14  # of bars side by side


class Case(NamedTuple):
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
GROWING = tuple(case._replace(name=f"{case.name} growing", growth=GROWTH) for case in CASES[3:])


def assumptions(seconds: float) -> str:
    """What is assumed, in words."""
    return (
        f"SIMULATED bursts ({seconds:g} s, Poisson, {RATE / 1e3:g} kHz after {100 * VALIDATED:g} % validation). "
        "Assumed: Gaussian turbulence, the same along x, spectrum of a channel LES scaled with $y/u_\\tau$, "
        f"$v'$ = {V_PLUS:g} $u_\\tau$, $u_\\tau$ = {FRICTION[0.3]:g} m/s at Mach 0.3 and {FRICTION[0.1]:.2f} at 0.1; "
        "no steady $v_0$; one incident wave decaying by the lined duct's mode (uniform flow, Ingard-Myers); "
        f"$v = p/(\\rho c Z)$, spread over a 3 x 3 grid of holes ({1e3 * HOLE_SPACING:.3g} mm apart, none in "
        "the middle) by potential flow up to $y$."
    )


class Turbulence:
    """Gaussian noise with the spectrum of v in a plane of the channel simulation."""

    def __init__(self) -> None:
        plane = tl.read_plane(SOURCE_PLANE)
        values = plane.velocity.reshape(-1, plane.samples).to(torch.float64)
        values = values - values.mean(1, keepdim=True)
        window = torch.hann_window(plane.samples, dtype=torch.float64)
        self.power = torch.fft.rfft(values * window).abs().square().mean(0).numpy()
        self.power[0] = self.power[1]  # the mean was taken off
        self.frequency = np.fft.rfftfreq(plane.samples, 1 / plane.sampling_rate)
        self.pace = SOURCE_FRICTION / (plane.height or math.nan)  # 1/s

    def at(self, times: np.ndarray, pace: float, rms: float, seed: int) -> np.ndarray:
        """v at times, m/s, from a record of ``FINE`` Hz; ``pace`` is u_tau/y, 1/s."""
        samples = math.ceil(times[-1] * FINE) + 2
        scaled = np.fft.rfftfreq(samples, 1 / FINE) * self.pace / pace
        amplitude = np.sqrt(np.interp(scaled, self.frequency, self.power, right=0.0))
        white = np.random.default_rng(seed).standard_normal((len(scaled), 2)) @ np.array([1, 1j])
        values = np.fft.irfft(white * amplitude, n=samples)
        return np.asarray(rms / values.std() * values[np.rint(times * FINE).astype(int)])

    def above(
        self, times: np.ndarray, x: float, mach: float, growth: float, seed: int, height: float = 1e-3
    ) -> np.ndarray:
        """v at times, m/s, above a place of the liner, along which its rms grows by a share."""
        friction = FRICTION[mach]
        return self.at(times, friction / height, V_PLUS * friction * (1 + growth * x / LENGTH), seed)


def arrivals(generator: np.random.Generator, rate: float, seconds: float, count: int) -> np.ndarray:
    """Times of at most ``count`` Poisson arrivals, s."""
    times = np.cumsum(generator.exponential(1 / rate, count))
    return times[times < seconds]


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


def settled_impedance(liner: Any, rms: float, pressure: float) -> complex:
    """Z of the model at the velocity that it lets in itself: Gaussian turbulence plus the tone."""
    turbulent = torch.linspace(-5, 5, 201, dtype=torch.float64)
    weight = torch.exp(-(turbulent**2) / 2)
    phase = torch.arange(24, dtype=torch.float64) * 2 * torch.pi / 24
    z = complex(1.5, -0.3)
    for _ in range(60):
        peak = pressure / (tl.Fluid().characteristic_impedance * abs(z))
        speed = (rms * turbulent[:, None] + peak * torch.cos(phase)).abs()
        reflection = tl.reflection_from_impedance(liner.impedance(FREQUENCY, speed))
        mean = (weight[:, None] * reflection).sum() / (weight.sum() * len(phase))
        z = 0.5 * z + 0.5 * complex(tl.impedance_from_reflection(mean))
    return z


def wave_of(case: Case, liner: Any) -> tuple[complex, complex]:
    """Z of the liner, as the bursts are made with, and the wavenumber of the lined duct, 1/m."""
    z = settled_impedance(liner, V_PLUS * FRICTION[case.mach], pressure_amplitude_from_spl(case.level))
    direction = {"upstream": "downstream", "downstream": "upstream"}[case.side]
    about: Any = {"height": HEIGHT, "mach": case.mach, "sound_speed": tl.Fluid().sound_speed}
    return z, complex(wavenumber_from_impedance(torch.tensor(z), FREQUENCY, direction=direction, **about))


def write_case(case: Case, liner: Any, turbulence: Turbulence, folder: Path, stations: int, seconds: float) -> None:
    """Files of bursts of one configuration."""
    places = (np.arange(stations) + 0.5) * LENGTH / stations
    z, wavenumber = wave_of(case, liner)
    way = places - (0.0 if case.side == "upstream" else LENGTH)  # from where the wave meets the liner
    pressure = pressure_amplitude_from_spl(case.level) * np.exp(-1j * wavenumber * way)
    velocity = pressure / (tl.Fluid().characteristic_impedance * z)
    velocity = velocity * imprint(places, case.height, liner.cell_pitch, liner.orifice_diameter)
    about: Any = {"y": case.height, "z": 6.34e-3, "frequency": FREQUENCY, "mach": case.mach, "source_side": case.side}
    about |= {"incident_level": case.level, "displacement_thickness": DISPLACEMENT, "liner": "onera"}
    about |= {"provenance": {"simulated": assumptions(seconds)}}
    for i, (x, amplitude) in enumerate(zip(places, velocity, strict=True)):
        seed = int(1e5 * case.mach) + 1000 * round(case.level) + 7919 * i + len(case.side)
        generator = np.random.default_rng(seed)
        times = arrivals(generator, RATE / VALIDATED, seconds, int(1.01 * RATE / VALIDATED * seconds) + 500)
        values = turbulence.above(times, x, case.mach, case.growth, seed + 1, case.height)
        # Into the liner is -v.
        values -= np.abs(amplitude) * np.cos(2 * np.pi * FREQUENCY * times + np.angle(amplitude))
        valid = generator.random(len(times)) < VALIDATED
        about |= {"x": float(x), "title": f"x{1e3 * x:.1f}"}
        record = tl.BurstRecord(times[valid], wall_normal=values[valid], **about)
        record.write(folder / f"station_{i:03d}.h5")


def parts_of(found: Any, name: str) -> dict[str, np.ndarray]:
    """Z of a line's average, its interval and its spreads, as R or X."""
    values = {"z": found.impedance, "low": found.interval.low, "high": found.interval.high}
    values |= {"draws": found.monte_carlo_spread, "along": found.spatial_spread}
    return {key: fig.part_of(value, name)[0] for key, value in values.items()}


def rise(line: tl.ImpedanceLine, part: str) -> float:
    """Of R or X along the liner, by a straight line."""
    return float(np.polyfit(line.x.numpy(), fig.part_of(line.impedance[:, 0], part), 1)[0] * LENGTH)


def averages_figure(lines: dict[str, tl.ImpedanceLine]) -> fig.Figure:
    """Z of (5.2) of several lines (figure 12); right of the symbol the statistical interval, the paper's three standard
    deviations of the draws, and the spread along the line."""
    figure, axes = fig.subplots(1, 2, 3.4)
    places = np.arange(len(lines))
    for axis, (part, text) in zip(axes[0], fig.PARTS, strict=True):
        every = [parts_of(line.average, part) for line in lines.values()]
        z, low, high, drawn, along = (np.array([each[name] for each in every]) for name in every[0])
        drawn = WIDTHS_OF_SEGMENTS * drawn
        bars = {
            "95 % interval": (low, high, "-"),
            "3 standard deviations of the draws of (5.2)": (z - drawn, z + drawn, "-"),
            "spread along the line": (z - along, z + along, "--"),
        }
        for i, (label, (*ends, dash)) in enumerate(bars.items()):
            look: Any = {"color": fig.COLOURS[i], "linestyle": dash, "linewidth": 1.8, "label": label}
            axis.vlines(places + (i - 1) * SHIFT, *ends, **look)
        at, paper = places - 2 * SHIFT, fig.part_of([PAPER.get(name) for name in lines], part)
        axis.plot(at, z, "o", color="k", markersize=3, zorder=4, label="$Z_\\mathrm{mean}$")
        axis.plot(at, paper, "*", color=fig.COLOURS[3], markersize=8, zorder=4, label="paper")
        axis.set_xticks(places, [name.replace(", ", "\n") for name in lines], fontsize=7)
        axis.set(xlabel="configuration", ylabel=text, xlim=(-0.5, len(lines) - 0.5))
    fig.legend_below(figure, axes[0, 0], 3)
    return figure


@fig.styled
def draw(lines: dict[str, tl.ImpedanceLine], folder: Path, seconds: float) -> None:
    """Figures 10 to 12, each with the assumptions in its caption."""
    labels = [f"{c.name}: Mach {c.mach:g}, {c.level:g} dB, {c.side}" for c in CASES]
    along = draw_lines([lines[case.name] for case in CASES], labels=labels)
    heights = draw_lines([lines["3"], lines[HIGH.name]], labels=["y = 1 mm", "y = 2.5 mm"])
    averages = averages_figure({case.name: lines[case.name] for case in (*CASES[:3], HIGH, *CASES[3:])})
    for name, figure, caption in (
        ("impedance", along, "liner onera, 1500 Hz, y = 1 mm"),
        ("heights", heights, "configuration 3 at two heights"),
        ("averages", averages, "admittance averages (5.2) by configuration"),
    ):
        fig.finish(figure, folder / f"b2a_{name}.png", f"{caption}; {assumptions(seconds)}")


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, FIGURES, stations=120, seconds=10.0), arguments)
    if options.seconds < 2.6:
        sys.exit("--seconds is too short for intervals; four segments of 1 s take 2.5 s")
    liner, turbulence = tl.load_liner("onera"), Turbulence()
    lines, stations = dict[str, tl.ImpedanceLine](), list[dict[str, Any]]()
    for case in (*CASES, HIGH, *GROWING):
        with tempfile.TemporaryDirectory() as place:
            write_case(case, liner, turbulence, Path(place), options.stations, options.seconds)
            line = lines[case.name] = tl.educe_bursts(place, liner, phase="averaged")
        for x, z in zip(line.x.tolist(), line.impedance[:, 0].tolist(), strict=True):
            stations.append({"configuration": case.name, "x (m)": x, "resistance": z.real, "reactance": z.imag})
        average: Any = line.average
        mean = parts_of(average, "resistance")
        decay = 20 * math.log10(math.e) * abs(wave_of(case, liner)[1].imag) * LENGTH
        print(
            f"{case.name:10s} Z {format_complex(complex(average.impedance[0]))}  interval R {mean['low']:.4f} to "
            f"{mean['high']:.4f}  along x R {rise(line, 'resistance'):+.3f} X {rise(line, 'reactance'):+.3f}  v' "
            f"{float(line.velocity_rms.mean()):.2f} m/s  decay {decay:.1f} dB",
            flush=True,
        )
    added = [tl.goodrich_resistance(m, 0.0395, DISPLACEMENT, 0.991e-3) for m in (0.1, 0.3)]
    third, fourth = (float(parts_of(lines[name].average, "resistance")["z"]) for name in "34")
    rises = f"R {fourth - third:+.3f}, Goodrich {added[1] - added[0]:+.3f}, paper 0.94 to 1.12"
    print(f"from configuration 3 to 4: {rises}")
    write_rows(stations, options.output / "b2a_stations.csv", ".6g")
    draw(lines, options.output, options.seconds)
    return 0


if __name__ == "__main__":
    sys.exit(main())
