"""Every eduction method on one and the same simulated duct, whose impedance is known.

    python scripts/side_by_side.py [-o FOLDER] [--seconds 4] [--stations 24]

The duct is B2A at Mach 0.3, 1500 Hz, 145 dB, source upstream or downstream. At each of 60 places
along the liner the wave that is there is reflected by the liner's own impulse response at the
instantaneous velocity |v_n(t)|, eq. (3.2), where v_n is turbulence plus what the sound itself
makes; the impedances that come of it are the wall of the linearised Euler equations, whose field is
the sound: a fixed point. From the one world so found every method is given what it would measure.
"""

import math
import sys
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchliner as tl
from b2a_line import FRICTION, LENGTH, Turbulence, arrivals, imprint
from b2a_line import RATE as BURST_RATE
from common import FIGURES, options_of, parser_of
from torchliner.duct.case import impedance_along
from torchliner.duct.field import DuctField
from torchliner.duct.presets import DuctSetup, load_duct
from torchliner.liners.plates import cavity_propagation
from torchliner.report import figure as fig
from torchliner.report.table import table_of
from torchliner.studies.variants import Row

FREQUENCY, MACH = 1500.0, 0.3
PLACES, RATE, HEIGHT = 60, 50e3, 1.0e-3  # along the liner; Hz and m of the plane
ROUNDS, SETTLED = 30, 1e-6  # of the fixed point
CHECKED = 6  # every sixth place by the literal sum, which takes long
WORLDS = {"turbulence alike along x": 0.0, "turbulence growing by 35 %": 0.35}
SIDES = ("upstream", "downstream")
BLOCKS = 8  # of the record, for the error of the in situ method
DRAWS = 500
TURBULENT_PRESSURE = 3.0  # rms over rho u_tau^2
SHOWN = ("true", "DIR-TDIBC", "in situ")  # Z along the liner
Rows = list[Row]


@dataclass(frozen=True)
class World:
    """What is, and what can be measured of it.

    Args:
        name, side: of the turbulence; of the source.
        setup, solver, field: duct; of its field; with this wall.
        x, impedance: places, m, and Z there, (P,).
        turbulence: wall-normal velocity into the liner without the tone, m/s, (P, T).
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

    def row(self, method: str, z: Any, low: Any, high: Any) -> Row:
        """One educed value and its interval beside the truth."""
        z = complex(z)
        about: Any = {"turbulence": self.name, "source": self.side, "method": method, "impedance": z}
        return Row(about, low=complex(low), high=complex(high), error=z - self.truth)


class Tone(tl.Tones):
    """Outside the record it and the velocity repeat."""

    edge = "periodic"


def tone(amplitude: np.ndarray, samples: int) -> np.ndarray:
    """Real signals of complex peaks (P,), (P, T)."""
    return np.real(amplitude[:, None] * np.exp(2j * np.pi * FREQUENCY * np.arange(samples) / RATE))


def plane_of(x: np.ndarray, into_liner: np.ndarray, side: str) -> tl.VelocityPlane:
    """A measured plane; files store v away from the liner."""
    about: Any = {"sampling_rate": RATE, "frequency": FREQUENCY, "height": HEIGHT, "mach": MACH, "source_side": side}
    return tl.VelocityPlane(-into_liner, x=x, liner="onera", name=f"simulated plane, source {side}", **about)


def settle(name: str, side: str, liner: Any, turbulence: np.ndarray, x: np.ndarray) -> World:
    """The wall and the sound that belong together."""
    setup = load_duct("b2a", source_side=side, frequency=[FREQUENCY])
    solver = tl.DuctSolver(setup.case, setup.frequency)
    impedance, moved = np.full(len(x), 2.0 - 0.3j), math.inf
    for _ in range(ROUNDS):
        new = reflect(solver.solve(impedance_along(x, impedance)), liner, turbulence, x)
        moved, impedance = float(np.abs(new - impedance).max()), new
        if moved < SETTLED:
            break
    else:
        raise RuntimeError(f"the wall did not settle: it still moves by {moved:.2g}")
    field = solver.solve(impedance_along(x, impedance))
    some = slice(None, None, CHECKED)
    literal = reflect(field, liner, turbulence[some], x[some], literal=True)
    off = float(np.abs(literal - impedance[some]).max())
    return World(name, side, setup, solver, x, turbulence, impedance, field, off)


def reflect(field: DuctField, liner: Any, turbulence: np.ndarray, x: np.ndarray, literal: bool = False) -> np.ndarray:
    """Z that the wave of each place meets there, its phase to the velocity being known."""
    velocity = field.wall_velocity(x)[0].numpy()
    incident = field.wall_pressure(x, "lined")[0].numpy() + tl.Fluid().characteristic_impedance * velocity
    measured, phase = turbulence + tone(velocity, turbulence.shape[1]), np.angle(incident)
    if not literal:
        how: dict[str, Any] = {"averaging": "admittance", "interval": None, "phase": "given", "reference_phase": phase}
        return tl.educe(plane_of(x, measured, field.source), liner, **how).impedance[:, 0].numpy()
    found = []
    for i in range(len(x)):
        plane, wave = plane_of(x[i : i + 1], measured[i : i + 1], field.source), Tone(FREQUENCY, phase=phase[i])
        found.append(tl.replay(plane, liner, wave, window="boxcar", interval=None).impedance[0, 0])
    return np.array(found)


def by_velocity(world: World, liner: Any) -> tuple[Rows, tl.ImpedanceMap]:
    """DIR-TDIBC on planes: at the wall, at 1 mm, with a liner that is not it."""

    def measured(sound: np.ndarray) -> tl.VelocityPlane:
        return plane_of(world.x, world.turbulence + tone(sound, world.turbulence.shape[1]), world.side)

    at_wall = measured(world.sound)
    above = measured(world.sound * imprint(world.x, HEIGHT, liner.cell_pitch, liner.orifice_diameter))
    found = {
        "DIR-TDIBC, at the wall": tl.educe(at_wall, liner),
        "DIR-TDIBC, 1 mm above the holes": tl.educe(above, liner),
        "DIR-TDIBC, porosity 5 % too high": tl.educe(at_wall, replace(liner, porosity=1.05 * liner.porosity)),
    }
    rows = []
    for method, one in found.items():
        educed: Any = one.liner["admittance"]
        rows.append(world.row(method, educed.impedance[0], *educed.interval.bounds(0)))
    return rows, next(iter(found.values()))


def by_bursts(world: World, liner: Any, noise: Turbulence, growth: float, stations: int, seconds: float) -> Row:
    """DIR-TDIBC on laser Doppler bursts 1 mm above the holes."""
    x = (np.arange(stations) + 0.5) * LENGTH / stations
    sound = world.field.wall_velocity(x)[0].numpy() * imprint(x, HEIGHT, liner.cell_pitch, liner.orifice_diameter)
    about: Any = {"frequency": FREQUENCY, "mach": MACH, "source_side": world.side}
    about |= {"incident_level": 145.0, "liner": "onera"}
    records = []
    for i, (place, amplitude) in enumerate(zip(x.tolist(), sound, strict=True)):
        random = np.random.default_rng(7000 + i)
        times = arrivals(random, BURST_RATE, seconds, int(1.1 * BURST_RATE * seconds))
        into = noise.above(times, place, MACH, growth, 8000 + i)
        into += np.real(amplitude * np.exp(2j * np.pi * FREQUENCY * times))
        records.append(tl.BurstRecord(times, wall_normal=-into, x=place, y=HEIGHT, title=f"station {i}", **about))
    average: Any = tl.educe_bursts(records, liner, FREQUENCY).average
    return world.row("DIR-TDIBC, laser Doppler, 1 mm", average.impedance[0], *average.interval.bounds(0))


def hydrodynamic_pressure(noise: Turbulence, times: np.ndarray) -> np.ndarray:
    """Of the turbulence on the facesheet, Pa, (P, T)."""
    friction = FRICTION[MACH]
    rms = TURBULENT_PRESSURE * tl.Fluid().density * friction**2
    return np.stack([noise.at(times, friction / HEIGHT, rms, 9000 + i) for i in range(PLACES)])


def cavities(world: World, liner: Any, hydrodynamic: np.ndarray) -> tl.PressureRecord:
    """Pressures on the facesheet, with turbulence, and behind it, in cavities with losses."""
    fluid, samples = tl.Fluid(), world.turbulence.shape[1]
    omega = torch.tensor(2 * math.pi * FREQUENCY, dtype=torch.float64)
    turn = complex(torch.sinh(cavity_propagation(omega, liner.cavity_hydraulic_radius, fluid) * liner.cavity_depth))
    behind = fluid.characteristic_impedance * world.sound / (liner.open_area_fraction * turn)
    return tl.PressureRecord(
        tone(world.field.wall_pressure(world.x, "lined")[0].numpy(), samples) + hydrodynamic,
        tone(behind, samples),
        sampling_rate=RATE,
        x=world.x,
        cavity_depth=liner.cavity_depth,
        cavity_porosity=liner.open_area_fraction,
        cavity_hydraulic_radius=liner.cavity_hydraulic_radius,
        frequency=FREQUENCY,
        name="simulated cavities",
    )


def by_cavities(world: World, record: tl.PressureRecord) -> tuple[Rows, Any]:
    """Dean's method, and with a cavity that is 1 % deeper than thought."""
    assert record.cavity_depth is not None
    rows, every = [], {}
    samples = record.facesheet.shape[-1] // BLOCKS
    for label, depth, losses in (
        ("in situ, lossless cavity", 1.0, "none"),
        ("in situ, with losses", 1.0, "viscothermal"),
        ("the same, depth 1 % too small", 0.99, "viscothermal"),
    ):
        stated = replace(record, cavity_depth=depth * record.cavity_depth)
        every[label] = tl.in_situ(stated, losses=losses)
        parts = []
        for some in (slice(block * samples, (block + 1) * samples) for block in range(BLOCKS)):
            part = replace(stated, facesheet=record.facesheet[..., some], backplate=record.backplate[..., some])
            parts.append(complex(tl.in_situ(part, losses=losses).answer[0]))
        z = complex(every[label].answer[0])
        wide = 2.36 / math.sqrt(BLOCKS) * complex(np.std(np.real(parts), ddof=1), np.std(np.imag(parts), ddof=1))
        rows.append(world.row(label, z, z - wide, z + wide))
    return rows, every["in situ, with losses"]


def by_microphones(world: World) -> Rows:
    """On the wall opposite the liner; 95 % of draws of 0.1 dB and 0.1 degrees."""
    line = world.setup.line_of(world.field).over_liner()
    found: dict[str, Any] = {
        "Kumaresan-Tufts, rank 2": tl.kumaresan_tufts(line, draws=DRAWS),
        "two-wave fit": tl.two_wave_fit(line, draws=DRAWS),
        "LEE fit": tl.fit_field(line, world.solver, draws=DRAWS),
    }
    return [world.row(name, one.impedance[0], *(end[0] for end in one.interval())) for name, one in found.items()]


def profile(world: World, by_plane: tl.ImpedanceMap, by_cavity: Any) -> Rows:
    """Z along the liner: what it is, and what the local methods say."""
    local = by_plane.impedance[:, 0], by_cavity.points.impedance[:, 0]
    columns = {"x (m)": world.x, **dict(zip(SHOWN, (world.impedance, *local), strict=True))}
    rows = zip(*(column.tolist() for column in columns.values()), strict=True)
    return [Row(turbulence=world.name, source=world.side, **dict(zip(columns, row, strict=True))) for row in rows]


@fig.styled
def draw(rows: Rows, profiles: Rows, path: Path) -> fig.Figure:
    """Along x in the growing turbulence; averages of all methods in both."""
    figure, axes = fig.subplots(2, 2, 7.2)
    growing = list(WORLDS)[-1]
    methods = [method for method in dict.fromkeys(row.method for row in rows) if method != "true"]
    curves = []
    for i, side in enumerate(SIDES):
        mine = [p for p in profiles if (p.turbulence, p.source) == (growing, side)]
        for name, line, marker in zip(SHOWN, ("-", "none", "none"), ("", "x", "o"), strict=True):
            look: Any = {"color": fig.COLOURS[i], "linestyle": line, "marker": marker, "markersize": 3}
            look |= {"markerfacecolor": "none", "label": f"(a), (b): {name}, source {side}"}
            curves.append(fig.curve_of(mine, "x (m)", name, **look))
    fig.draw_parts(curves, fig.X_MM, poles=None, axes=axes[0])
    for column, (word, label) in enumerate(fig.PARTS):
        dots = axes[1, column]
        for row in rows:
            i, j, z = SIDES.index(row.source), list(WORLDS).index(row.turbulence), fig.part_of(row.impedance, word)
            if row.method == "true":
                dots.axvline(z, color=fig.COLOURS[i], linewidth=0.8, linestyle=("--", "-")[j])
                continue
            up = -methods.index(row.method) - 0.18 * (2 * i + j - 1.5)
            colour, ends = fig.COLOURS[i], [fig.part_of(row[end], word) for end in ("low", "high")]
            style: Any = {"color": colour, "markersize": 3.5, "markerfacecolor": colour if j else "white"}
            dots.hlines(up, *ends, color=colour, linewidth=0.8)
            dots.plot(z, up, fig.MARKERS[i], label=f"source {row.source}, {row.turbulence}", **style)
        dots.set_yticks([-i for i in range(len(methods))], methods if column == 0 else [])
        dots.tick_params(axis="y", length=0)
        for i in range(len(methods) - 1):
            dots.axhline(-i - 0.5, color="0.9", linewidth=0.5, zorder=0)
        dots.set(xlabel=label, ylim=(-len(methods) + 0.5, 0.5))
    fig.legend_below(figure, axes[:, 0], 2)
    caption = (
        f"SIMULATED, Z known: B2A, Mach 0.3, 1500 Hz, 145 dB, liner onera. (a), (b): {growing};"
        "\n(c), (d): averages along x, lines: known Z; bars: 95 % of what the record or the draws leave"
    )
    return fig.finish(figure, path, caption)


def main(arguments: Sequence[str] | None = None) -> int:
    options = options_of(parser_of(__doc__, FIGURES, seconds=4.0, stations=24), arguments)
    liner, noise = tl.load_liner("onera"), Turbulence()
    x = (np.arange(PLACES) + 0.5) * LENGTH / PLACES
    times = np.arange(round(options.seconds * RATE)) / RATE
    hydrodynamic = hydrodynamic_pressure(noise, times)
    rows, profiles = list[Row](), list[Row]()
    for name, growth in WORLDS.items():
        turbulence = np.stack([noise.above(times, place, MACH, growth, 5000 + i) for i, place in enumerate(x)])
        for side in SIDES:
            world = settle(name, side, liner, turbulence, x)
            z = world.impedance
            print(
                f"{name}, source {side}: true Z {world.truth:.4f}, R {z.real.min():.3f} to {z.real.max():.3f}, X "
                f"{z.imag.min():.3f} to {z.imag.max():.3f} along x; literal sum off by {world.literal_error:.1e}",
                flush=True,
            )
            planes, by_plane = by_velocity(world, liner)
            bursts = by_bursts(world, liner, noise, growth, options.stations, options.seconds)
            pressures, by_cavity = by_cavities(world, cavities(world, liner, hydrodynamic))
            rows += [*planes, bursts, *pressures, *by_microphones(world)]
            rows.append(world.row("true", world.truth, world.truth, world.truth))
            profiles += profile(world, by_plane, by_cavity)
    print(table_of(rows, "turbulence,source,method,impedance,error").as_text())
    table_of(rows).write_csv(options.output / "side_by_side.csv")
    table_of(profiles).write_csv(options.output / "side_by_side_along_x.csv")
    draw(rows, profiles, options.output / "side_by_side.png")
    return 0


if __name__ == "__main__":
    sys.exit(main())
