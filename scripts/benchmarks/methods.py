"""Studies, laser Doppler lines and the duct: each beside the same work done piece by piece."""

import functools
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import torch

import torchliner as tl
from benchmarks.engine import MANY, noise, plane_of
from benchmarks.harness import apart, best, row
from common import case_files
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import TanhProfile
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.solver import DuctSolver, solve_duct
from torchliner.pressure.microphone_errors import MicrophoneErrors

FREE = {
    "vena_contracta": (0.3, 1.0),
    "offset_resistance": (-0.2, 0.2),
    "offset_reactance": (-0.5, 0.6),
    "porosity": (0.01, 0.5),
    "cavity_depth": (5e-3, 0.1),
}
STATION, BURSTS, GRID, DOPPLER_TONE = 10.0, 250_000, 51e3, 1500.0  # s, a station, Hz, Hz
HEIGHT, FREQUENCY, IMPEDANCE = 50e-3, 1500.0, 2.33 - 0.30j  # B2A
CASE = DuctCase(TanhProfile(0.3, HEIGHT, 0.1), -0.2, 0.35, (0.0, 0.15))
MICROPHONES = -0.027 + 0.012 * np.arange(18)
# Degree, largest column and row, m, that give about 17 000, 45 000 and 224 000 unknowns.
MESHES = {17_000: (3, 0.0184, 0.01), 45_000: (4, 0.011, 0.01), 224_000: (4, 0.003, 0.005)}


def studies(options: Any) -> None:
    """The audit beside one ``educe``, a calibration on shipped planes."""
    plane, liner = plane_of(noise(options).cpu()), tl.load_liner("polito")
    seconds, audited = best(lambda: tl.audit(plane, liner), 1)
    each, one = best(functools.partial(tl.educe, plane, liner, interval=None), 1)
    row(f"audit, {len(audited.rows)} variants", seconds, error=abs(audited.base - complex(one.answer[0])))
    row("one educe of them", each)
    files = [path for case in ("n115", "n130") for path in case_files(case)[-3:]]
    slit = tl.load_liner("lbm_slit")
    kept: dict[str, Any] = {"cell_pitch": slit.cell_pitch, "averaging": "velocity"}
    seconds, reduced = best(lambda: [tl.moments(tl.read_plane(path), **kept) for path in files], 1)
    row(f"{len(files)} planes read and reduced", seconds)
    fit = functools.partial(tl.calibrate, reduced, slit, "true", FREE, noise=0.002)
    row(f"calibration, {len(FREE)} parameters on {len(files)} planes", best(fit)[0])
    educe = functools.partial(reduced[-1].educe, slit, averaging="velocity", interval=None)
    row("one map from moments", best(educe)[0])
    row("one map from moments, 60 frequencies", best(functools.partial(educe, MANY))[0])


def station(seed: int) -> tl.BurstRecord:
    """Random arrivals of slow turbulence with a tone."""
    generator = np.random.default_rng(seed)
    times = np.sort(generator.uniform(0, STATION, BURSTS))
    slow = np.interp(times, np.linspace(0, STATION, 40_000), generator.standard_normal(40_000))
    v = 1.5 * slow + np.cos(2 * np.pi * DOPPLER_TONE * times)
    return tl.BurstRecord(times, wall_normal=v, x=1e-3 * seed, y=1e-3, z=0.0, frequency=DOPPLER_TONE)


def bursts(options: Any) -> None:
    """A station of 10 s in segments of 1 s; a line of 120 stations from files."""
    liner, record = tl.load_liner("onera"), station(1)
    choices: dict[str, Any] = {"grid_rate": GRID, "flagged": "use", "correction": "none"}
    educe = functools.partial(tl.educe_bursts, [record], liner, **choices)
    row(f"a station of {BURSTS} bursts", best(educe)[0])
    more: dict[str, dict[str, Any]] = {
        "tone corrected": {"correction": "tone"},
        "self-consistent, tone corrected": {"correction": "tone", "phase": "self-consistent"},
        "band-limited reconstruction": {"correction": "tone", "method": "band-limited"},
    }
    for name, changed in more.items():
        row(f"a station, {name}", best(functools.partial(educe, **changed), 1)[0])
    stations = 120 if options.full else 6
    with tempfile.TemporaryDirectory() as folder:
        for i in range(stations):
            station(i).write(Path(folder) / f"s{i:03d}.h5")
        seconds, peak = apart("benchmarks.methods:line_of", folder)
        row(f"a line of {stations} stations from files", seconds, f"peak {peak:.0f} MB")


def line_of(folder: str) -> Callable[[], int]:
    """A line from its folder; for ``apart``."""
    liner = tl.load_liner("onera")
    return lambda: tl.educe_bursts(folder, liner, grid_rate=GRID, flagged="use").stations


def mesh_of(size: int) -> DuctMesh:
    """Of about so many unknowns."""
    degree, column, high = MESHES[size]
    return build_mesh(CASE, FREQUENCY, degree=degree, column=column, row=high)


def duct(options: Any) -> None:
    """B2A: three meshes, many impedances at once, draws of microphones."""
    torch.set_num_threads(1)
    for size in MESHES:
        mesh = mesh_of(size)
        row(f"{mesh.unknowns} unknowns", best(functools.partial(solve_duct, CASE, FREQUENCY, IMPEDANCE, mesh))[0])
    many_impedances()
    many_draws()


def many_impedances() -> None:
    """100 impedances x 20 frequencies in one batch, and some of them one at a time."""
    random = torch.rand(100, 2, generator=torch.Generator().manual_seed(0), dtype=torch.float64)
    walls = torch.complex(0.2 + 3 * random[:, 0], 3 * random[:, 1] - 1.5)[:, None, None]
    frequency, mesh = torch.linspace(500, 2400, 20, dtype=torch.float64), mesh_of(17_000)
    seconds, whole = best(lambda: DuctSolver(CASE, frequency, mesh).solve(walls).wall_pressure(MICROPHONES), 2)
    chosen = [(7 * i % 100, 3 * i % 20) for i in range(8)]

    def one_by_one() -> list[torch.Tensor]:
        return [solve_duct(CASE, frequency[f], walls[z], mesh).wall_pressure(MICROPHONES) for z, f in chosen]

    slow, ones = best(one_by_one, 1)
    error = max(float((one[0] - whole[z, f]).abs().max()) for one, (z, f) in zip(ones, chosen, strict=True))
    row("100 impedances x 20 frequencies, one batch", seconds)
    row("the same one by one (8 measured)", slow / len(chosen) * 2000, error=error)


def many_draws() -> None:
    """Draws of the errors of 12 microphones as one batch."""
    every = torch.linspace(500, 2400, 20, dtype=torch.float64)
    for name, frequency, draws in (("kumaresan_tufts", every, 500), ("fit_field", every[10:11], 100)):
        solver, over = DuctSolver(CASE, frequency), MICROPHONES[3:15]
        pressure = solver.solve(IMPEDANCE).wall_pressure(over).movedim(-1, -2)
        noisy = MicrophoneErrors(draws=draws).drawn(pressure)
        line = tl.MicrophoneLine(over, noisy, frequency, duct_height=HEIGHT, mach=0.3, source_side="upstream")
        fit = functools.partial(getattr(tl, name), line, *([solver] if name == "fit_field" else []))
        row(f"{name}, {draws} draws x {len(frequency)} frequencies, one batch", best(fit, 1)[0])
