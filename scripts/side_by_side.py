"""Every eduction method on one and the same simulated duct, whose impedance is known.

    python scripts/side_by_side.py [-o FOLDER] [--seconds 4] [--stations 24]

The duct is B2A at Mach 0.3, 1500 Hz, 145 dB, source upstream or downstream. At each of 60 places
along the liner the wave that is there is reflected by the liner's own impulse response at the
instantaneous velocity |v_n(t)|, eq. (3.2), where v_n is turbulence plus what the sound itself
makes; the impedances that come of it are the wall of the linearised Euler equations, whose field is
the sound: a fixed point. From the one world so found every method is given what it would measure.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

import b2a_line
import torchliner as tl
from common import FIGURES, options_of, parser_of
from torchliner.duct.case import impedance_along
from torchliner.duct.field import DuctField
from torchliner.duct.presets import DuctSetup, load_duct
from torchliner.io.csv_rows import write_rows
from torchliner.liners.plates import cavity_propagation
from torchliner.records import ImpedanceMap
from torchliner.report.figure import COLOURS, MARKERS, PARTS, Figure, finish, legend_below, styled, subplots

FREQUENCY, LENGTH, MACH = 1500.0, 0.150, 0.3
PLACES, RATE, HEIGHT = 60, 50e3, 1.0e-3  # along the liner; Hz and m of the plane
ROUNDS, SETTLED = 30, 1e-6  # of the fixed point
CHECKED = 6  # every sixth place by the literal sum, which takes long
WORLDS = {"turbulence alike along x": 0.0, "turbulence growing by 35 %": 0.35}
SIDES = ("upstream", "downstream")
BLOCKS = 8  # of the record, for the error of the in situ method
DRAWS = 500
TURBULENT_PRESSURE = 3.0  # rms over rho u_tau^2


@dataclass(frozen=True)
class World:
    """What is, and what can be measured of it.

    Args:
        name: of the turbulence.  side: of the source.
        setup: duct.  solver: of its field.
        x: places, m, (P,).
        turbulence: wall-normal velocity into the liner without the tone, m/s, (P, T).
        impedance: Z at the places, (P,).
        field: of the duct with that wall.
        literal_error: greatest |Z - Z of the literal sum (3.2)| over every sixth place.
    """

    name: str
    side: str
    setup: DuctSetup
    solver: tl.DuctSolver
    x: np.ndarray
    turbulence: np.ndarray
    impedance: np.ndarray
    field: DuctField
    literal_error: float

    @property
    def sound(self) -> np.ndarray:
        """Velocity into the liner, complex peak, m/s, (P,)."""
        return self.field.wall_velocity(self.x)[0].numpy()

    @property
    def truth(self) -> complex:
        """1 over the mean of 1/Z along the liner."""
        return complex(1 / (1 / self.impedance).mean())


class Tone(tl.Tones):
    """Outside the record it and the velocity repeat."""

    edge = "periodic"


def tone(amplitude: np.ndarray, times: np.ndarray) -> np.ndarray:
    """Real signals of complex peaks (P,), (P, T)."""
    phase = 2 * np.pi * FREQUENCY * times
    return np.real(amplitude[:, None] * np.exp(1j * phase))


def plane_of(x: np.ndarray, into_liner: np.ndarray, side: str) -> tl.VelocityPlane:
    """A measured plane; files store v away from the liner."""
    return tl.VelocityPlane(
        -into_liner,
        sampling_rate=RATE,
        x=x,
        frequency=FREQUENCY,
        height=HEIGHT,
        mach=MACH,
        source_side=side,
        liner="onera",
        name=f"simulated plane, source {side}",
    )


def settle(name: str, side: str, liner: Any, turbulence: np.ndarray, x: np.ndarray) -> World:
    """The wall and the sound that belong together."""
    setup = load_duct("b2a", source_side=side, frequency=[FREQUENCY])
    solver = tl.DuctSolver(setup.case, setup.frequency)
    times = np.arange(turbulence.shape[1]) / RATE
    impedance = np.full(len(x), 2.0 - 0.3j)
    for _ in range(ROUNDS):
        field = solver.solve(impedance_along(x, impedance))
        new = reflect(field, liner, turbulence, x, times)
        moved = np.abs(new - impedance).max()
        impedance = new
        if moved < SETTLED:
            break
    else:
        raise RuntimeError(f"the wall did not settle: it still moves by {moved:.2g}")
    field = solver.solve(impedance_along(x, impedance))
    some = slice(None, None, CHECKED)
    literal = reflect(field, liner, turbulence[some], x[some], times, literal=True)
    literal_error = float(np.abs(literal - impedance[some]).max())
    return World(name, side, setup, solver, x, turbulence, impedance, field, literal_error)


def reflect(
    field: DuctField, liner: Any, turbulence: np.ndarray, x: np.ndarray, times: np.ndarray, literal: bool = False
) -> np.ndarray:
    """Z that the wave of each place meets there, its phase to the velocity being known."""
    velocity = field.wall_velocity(x)[0].numpy()
    pressure = field.wall_pressure(x, "lined")[0].numpy()
    incident = pressure + tl.Fluid().characteristic_impedance * velocity
    measured, phase = turbulence + tone(velocity, times), np.angle(incident)
    if not literal:
        plane = plane_of(x, measured, field.source)
        how: dict[str, Any] = {"averaging": "admittance", "interval": None}
        return tl.educe(plane, liner, phase="given", reference_phase=phase, **how).impedance[:, 0].numpy()
    found = []
    for i in range(len(x)):
        plane, wave = plane_of(x[i : i + 1], measured[i : i + 1], field.source), Tone(FREQUENCY, phase=phase[i])
        found.append(tl.replay(plane, liner, wave, window="boxcar", interval=None).impedance[0, 0])
    return np.array(found)


def mapped(method: str, world: World, found: ImpedanceMap) -> dict[str, Any]:
    """A map's average with its statistical interval."""
    educed = found.liner["admittance"]
    interval = educed.interval
    assert interval is not None
    return result(method, world, complex(educed.impedance[0]), complex(interval.low[0]), complex(interval.high[0]))


def result(method: str, world: World, z: complex, low: complex, high: complex) -> dict[str, Any]:
    """One educed value beside the truth."""
    return {
        "turbulence": world.name,
        "source": world.side,
        "method": method,
        "resistance": z.real,
        "reactance": z.imag,
        "resistance low": low.real,
        "resistance high": high.real,
        "reactance low": low.imag,
        "reactance high": high.imag,
        "error of resistance": z.real - world.truth.real,
        "error of reactance": z.imag - world.truth.imag,
    }


def by_velocity(world: World, liner: Any) -> tuple[list[dict[str, Any]], ImpedanceMap]:
    """DIR-TDIBC on planes: at the wall, at 1 mm, with a liner that is not it."""
    times = np.arange(world.turbulence.shape[1]) / RATE
    at_wall = plane_of(world.x, world.turbulence + tone(world.sound, times), world.side)
    shape = b2a_line.imprint(world.x, HEIGHT, liner.cell_pitch, liner.orifice_diameter)
    above = plane_of(world.x, world.turbulence + tone(world.sound * shape, times), world.side)
    wrong = replace(liner, porosity=1.05 * liner.porosity)
    first = tl.educe(at_wall, liner)
    rows = [
        mapped("DIR-TDIBC, at the wall", world, first),
        mapped("DIR-TDIBC, 1 mm above the holes", world, tl.educe(above, liner)),
        mapped("DIR-TDIBC, porosity 5 % too high", world, tl.educe(at_wall, wrong)),
    ]
    return rows, first


def by_bursts(
    world: World, liner: Any, noise: b2a_line.Turbulence, growth: float, stations: int, seconds: float
) -> dict[str, Any]:
    """DIR-TDIBC on laser Doppler bursts 1 mm above the holes."""
    x = (np.arange(stations) + 0.5) * LENGTH / stations
    shape = b2a_line.imprint(x, HEIGHT, liner.cell_pitch, liner.orifice_diameter)
    sound = world.field.wall_velocity(x)[0].numpy() * shape
    records = []
    for i, (place, amplitude) in enumerate(zip(x, sound, strict=True)):
        generator = np.random.default_rng(7000 + i)
        gaps = generator.exponential(1 / b2a_line.RATE, int(1.1 * b2a_line.RATE * seconds))
        times = np.cumsum(gaps)
        times = times[times < seconds]
        turbulent = turbulence_at(noise, times, float(place), growth, 8000 + i)
        into = turbulent + np.real(amplitude * np.exp(2j * np.pi * FREQUENCY * times))
        records.append(
            tl.BurstRecord(
                times,
                wall_normal=-into,
                x=float(place),
                y=HEIGHT,
                frequency=FREQUENCY,
                mach=MACH,
                incident_level=145.0,
                source_side=world.side,
                liner="onera",
                title=f"station {i}",
            )
        )
    average = tl.educe_bursts(records, liner, FREQUENCY).average
    assert average is not None
    assert average.interval is not None
    return result(
        "DIR-TDIBC, laser Doppler, 1 mm",
        world,
        complex(average.impedance[0]),
        complex(average.interval.low[0]),
        complex(average.interval.high[0]),
    )


def turbulence_at(noise: b2a_line.Turbulence, times: np.ndarray, x: float, growth: float, seed: int) -> np.ndarray:
    """v at a place, m/s."""
    friction = b2a_line.FRICTION[MACH]
    rms = b2a_line.V_PLUS * friction * (1 + growth * x / LENGTH)
    return noise.at(times, friction / HEIGHT, rms, seed)


def hydrodynamic_pressure(noise: b2a_line.Turbulence, times: np.ndarray) -> np.ndarray:
    """Of the turbulence on the facesheet, Pa, (P, T)."""
    friction = b2a_line.FRICTION[MACH]
    rms = TURBULENT_PRESSURE * tl.Fluid().density * friction**2
    return np.stack([noise.at(times, friction / HEIGHT, rms, 9000 + i) for i in range(PLACES)])


def cavities(world: World, liner: Any, hydrodynamic: np.ndarray) -> tl.PressureRecord:
    """Pressures on the facesheet, with turbulence, and behind it, in cavities with losses."""
    fluid = tl.Fluid()
    times = np.arange(world.turbulence.shape[1]) / RATE
    omega = torch.tensor(2 * math.pi * FREQUENCY, dtype=torch.float64)
    radius = torch.tensor(liner.cavity_hydraulic_radius, dtype=torch.float64)
    turn = complex(torch.sinh(cavity_propagation(omega, radius, fluid) * liner.cavity_depth))
    behind = fluid.characteristic_impedance * world.sound / (liner.open_area_fraction * turn)
    return tl.PressureRecord(
        tone(world.field.wall_pressure(world.x, "lined")[0].numpy(), times) + hydrodynamic,
        tone(behind, times),
        sampling_rate=RATE,
        x=world.x,
        cavity_depth=liner.cavity_depth,
        cavity_porosity=liner.open_area_fraction,
        probe_cell=np.arange(len(world.x)),
        cavity_hydraulic_radius=liner.cavity_hydraulic_radius,
        frequency=FREQUENCY,
        name="simulated cavities",
    )


def by_cavities(world: World, record: tl.PressureRecord) -> tuple[list[dict[str, Any]], Any]:
    """Dean's method, and with a cavity that is 1 % deeper than thought."""
    assert record.cavity_depth is not None
    rows, first = [], None
    samples = record.facesheet.shape[-1] // BLOCKS
    for label, depth, losses in (
        ("in situ, lossless cavity", 1.0, "none"),
        ("in situ, with losses", 1.0, "viscothermal"),
        ("the same, depth 1 % too small", 0.99, "viscothermal"),
    ):
        stated = replace(record, cavity_depth=depth * record.cavity_depth)
        found = tl.in_situ(stated, losses=losses)
        parts = []
        for block in range(BLOCKS):
            some = slice(block * samples, (block + 1) * samples)
            part = replace(stated, facesheet=record.facesheet[..., some], backplate=record.backplate[..., some])
            parts.append(complex(tl.in_situ(part, losses=losses).liner_impedance[0]))
        z = complex(found.liner_impedance[0])
        wide = 2.36 / math.sqrt(BLOCKS) * complex(np.std(np.real(parts), ddof=1), np.std(np.imag(parts), ddof=1))
        rows.append(result(label, world, z, z - wide, z + wide))
        first = found if label == "in situ, with losses" else first
    return rows, first


def by_microphones(world: World) -> list[dict[str, Any]]:
    """On the wall opposite the liner; 95 % of draws of 0.1 dB and 0.1 degrees."""
    line = world.setup.line_of(world.field).over_liner()
    found: dict[str, Any] = {
        "Kumaresan-Tufts, rank 2": tl.kumaresan_tufts(line, draws=DRAWS),
        "two-wave fit": tl.two_wave_fit(line, draws=DRAWS),
        "LEE fit": tl.fit_field(line, world.solver, draws=DRAWS),
    }
    rows = []
    for method, one in found.items():
        drawn = one.draws.impedance[:, 0].numpy()
        low, high = (
            complex(np.quantile(drawn.real, share), np.quantile(drawn.imag, share)) for share in (0.025, 0.975)
        )
        rows.append(result(method, world, complex(one.impedance[0]), low, high))
    return rows


def profile(world: World, by_plane: ImpedanceMap, by_cavity: Any) -> list[dict[str, Any]]:
    """Z along the liner: what it is, and what the local methods say."""
    return [
        {
            "turbulence": world.name,
            "source": world.side,
            "x (m)": x,
            "true resistance": z.real,
            "true reactance": z.imag,
            "DIR-TDIBC resistance": one.real,
            "DIR-TDIBC reactance": one.imag,
            "in situ resistance": other.real,
            "in situ reactance": other.imag,
        }
        for x, z, one, other in zip(
            world.x.tolist(),
            world.impedance.tolist(),
            by_plane.impedance[:, 0].tolist(),
            by_cavity.point_impedance[:, 0].tolist(),
            strict=True,
        )
    ]


@styled
def draw(
    rows: Sequence[dict[str, Any]],
    profiles: Sequence[dict[str, Any]],
    truths: dict[tuple[str, str], complex],
    path: Path,
) -> Figure:
    """Along x in the growing turbulence; averages of all methods in both."""
    figure, axes = subplots(2, 2, 7.2)
    growing = list(WORLDS)[-1]
    methods = list(dict.fromkeys(row["method"] for row in rows))
    for column, (word, (_, label)) in enumerate(zip(("resistance", "reactance"), PARTS, strict=True)):
        axis, dots = axes[0, column], axes[1, column]
        for i, side in enumerate(SIDES):
            mine = [p for p in profiles if (p["turbulence"], p["source"]) == (growing, side)]
            x = [1e3 * p["x (m)"] for p in mine]
            axis.plot(x, [p[f"true {word}"] for p in mine], color=COLOURS[i], label=f"(a), (b): true, source {side}")
            axis.plot(
                x,
                [p[f"DIR-TDIBC {word}"] for p in mine],
                "x",
                color=COLOURS[i],
                markersize=3,
                label=f"(a), (b): DIR-TDIBC, source {side}",
            )
            axis.plot(
                x,
                [p[f"in situ {word}"] for p in mine],
                "o",
                color=COLOURS[i],
                markersize=3,
                markerfacecolor="none",
                label=f"(a), (b): in situ with losses, {side}",
            )
            for j, world in enumerate(WORLDS):
                truth = truths[world, side]
                value = {"resistance": truth.real, "reactance": truth.imag}[word]
                dots.axvline(value, color=COLOURS[i], linewidth=0.8, linestyle=("--", "-")[j])
                for row in rows:
                    if (row["turbulence"], row["source"]) != (world, side):
                        continue
                    up = -methods.index(row["method"]) - 0.18 * (2 * i + j - 1.5)
                    ends = [row[f"{word} low"], row[f"{word} high"]]
                    dots.plot(ends, [up, up], color=COLOURS[i], linewidth=0.8)
                    dots.plot(
                        row[word],
                        up,
                        MARKERS[i],
                        color=COLOURS[i],
                        markersize=3.5,
                        markerfacecolor=COLOURS[i] if j else "white",
                        label=f"source {side}, {world}",
                    )
        axis.set_xlabel("$x$ (mm)")
        axis.set_ylabel(label)
        dots.set_xlabel(label)
        dots.set_yticks([-i for i in range(len(methods))], methods if column == 0 else [])
        dots.tick_params(axis="y", length=0)
        for i in range(len(methods) - 1):
            dots.axhline(-i - 0.5, color="0.9", linewidth=0.5, zorder=0)
        dots.set_ylim(-len(methods) + 0.5, 0.5)
    legend_below(figure, axes[:, 0], 2)
    words = (
        f"SIMULATED, Z known: B2A, Mach 0.3, 1500 Hz, 145 dB, liner onera. (a), (b): {growing};"
        "\n(c), (d): averages along x, lines: known Z; bars: 95 % of what the record or the draws "
        "leave"
    )
    return finish(figure, path, words)


def main(arguments: Sequence[str] | None = None) -> int:
    parser = parser_of(__doc__, FIGURES)
    parser.add_argument("--seconds", type=float, default=4.0, help="of planes and bursts")
    parser.add_argument("--stations", type=int, default=24, help="of laser Doppler bursts")
    options = options_of(parser, arguments)
    liner, noise = tl.load_liner("onera"), b2a_line.Turbulence()
    x = (np.arange(PLACES) + 0.5) * LENGTH / PLACES
    times = np.arange(round(options.seconds * RATE)) / RATE
    hydrodynamic = hydrodynamic_pressure(noise, times)
    rows, profiles, truths = [], [], {}
    for name, growth in WORLDS.items():
        turbulence = np.stack([turbulence_at(noise, times, place, growth, 5000 + i) for i, place in enumerate(x)])
        for side in SIDES:
            world = settle(name, side, liner, turbulence, x)
            truths[name, side] = world.truth
            z = world.impedance
            print(
                f"{name}, source {side}: true Z {world.truth:.4f}, R {z.real.min():.3f} to "
                f"{z.real.max():.3f}, X {z.imag.min():.3f} to {z.imag.max():.3f} along x; the "
                f"literal sum is off by {world.literal_error:.1e} at most",
                flush=True,
            )
            planes, by_plane = by_velocity(world, liner)
            bursts = by_bursts(world, liner, noise, growth, options.stations, options.seconds)
            pressures, by_cavity = by_cavities(world, cavities(world, liner, hydrodynamic))
            rows += [*planes, bursts, *pressures, *by_microphones(world)]
            profiles += profile(world, by_plane, by_cavity)
            rows.append(result("true", world, world.truth, world.truth, world.truth))
    for row in rows:
        print(
            f"{row['turbulence'][11:18]:8s} {row['source']:10s} {row['method']:34s} "
            f"{row['resistance']:.3f}{row['reactance']:+.3f}j  off by "
            f"{row['error of resistance']:+.3f} {row['error of reactance']:+.3f}"
        )
    write_rows(rows, options.output / "side_by_side.csv")
    write_rows(profiles, options.output / "side_by_side_along_x.csv")
    shown = [row for row in rows if row["method"] != "true"]
    draw(shown, profiles, truths, options.output / "side_by_side.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
