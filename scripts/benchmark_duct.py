"""Time, memory and difference of the duct solver against one sparse LU of the same equations.

    python scripts/benchmark_duct.py [--only sizes,batch,microphones,settled] [--largest 45000]

The case is the B2A duct: 50 mm high, 150 mm of liner with Z = 2.33-0.30j, sheared flow of bulk Mach
0.3 (tanh profile, shear 0.1), 1500 Hz, source upstream. ``sizes`` solves it on meshes of about
17 000, 45 000 and 224 000 unknowns by the condensed columns (condensation, sweeps, wall pressure at
18 microphones) and, up to ``--largest``, by scipy's sparse LU (COLAMD, the quickest of its orders
here) of the assembled matrix; assembling it is timed apart. Each runs in a process of its own, so
that its peak of memory is its own; that of the same process before, with its imports, is taken off.
``batch`` solves 100 impedances x 20 frequencies (500 to 2400 Hz) at once, and some of them one at a
time, extrapolated; ``microphones`` draws of the errors of 12 microphones likewise. Times are the
best of three after one that is not counted, once for the LU.
"""

from __future__ import annotations

import argparse
import dataclasses
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import torch
from scipy.sparse.linalg import splu

import torchliner as tl
from common import options_of, parser_of
from oracles.lee_assembled import assemble
from torchliner.duct.case import DuctCase
from torchliner.duct.flow_profiles import TanhProfile
from torchliner.duct.growing_wave import growing_wave
from torchliner.duct.mesh import DuctMesh, build_mesh
from torchliner.duct.settled import solve_settled
from torchliner.duct.solver import DuctSolver, solve_duct
from torchliner.pressure.microphone_errors import draw_pressures
from verify_duct import node_places

HEIGHT, FREQUENCY, IMPEDANCE = 50e-3, 1500.0, 2.33 - 0.30j
CASE = DuctCase(TanhProfile(0.3, HEIGHT, 0.1), -0.2, 0.35, (0.0, 0.15))
MICROPHONES = -0.027 + 0.012 * np.arange(18)
# Degree, largest column and row, m, that give about 17 000, 45 000 and 224 000 unknowns.
MESHES: dict[int, tuple[int, float, float]] = {
    17000: (3, 0.0184, 0.01), 45000: (4, 0.011, 0.01), 224000: (4, 0.003, 0.005),
}  # fmt: skip


def mesh_of(size: int) -> DuctMesh:
    degree, column, row = MESHES[size]
    return build_mesh(CASE, FREQUENCY, degree=degree, column=column, row=row)


def best(work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
    """Seconds of the fastest run after one that is not counted, and what it returned."""
    result, fastest = work(), float("inf")
    for _ in range(repeats):
        start = time.perf_counter()
        result = work()
        fastest = min(fastest, time.perf_counter() - start)
    return fastest, result


def peak() -> float:
    """MB that this process held at most."""
    scale = 1 if platform.system() == "Darwin" else 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * scale / 1e6


def run_columns(size: int, out: str) -> None:
    mesh, before = mesh_of(size), peak()

    def work() -> Any:
        field = solve_duct(CASE, FREQUENCY, IMPEDANCE, mesh)
        field.wall_pressure(MICROPHONES)
        return field

    seconds, field = best(work)
    memory = peak() - before
    x, y = (places.ravel() for places in node_places(mesh))
    np.save(out, field.at(x, y)[0][0].numpy())
    print(f"{mesh.unknowns} {seconds:.3f} {memory:.0f}")


def run_sparse(size: int, out: str) -> None:
    mesh, before = mesh_of(size), peak()
    start = time.perf_counter()
    matrix, right = assemble(CASE, FREQUENCY, IMPEDANCE, mesh)
    assembled = time.perf_counter() - start
    start = time.perf_counter()
    found = splu(matrix, permc_spec="COLAMD").solve(right)
    seconds, memory, n = time.perf_counter() - start, peak() - before, mesh.degree + 1
    np.save(out, found.reshape(len(mesh.x) - 1, len(mesh.y) - 1, 3, n, n)[:, :, 0].ravel())
    print(f"{mesh.unknowns} {seconds:.3f} {memory:.0f} {assembled:.3f}")


def apart(kind: str, size: int, out: Path, threads: int) -> list[float]:
    """One run in its own process."""
    command = [sys.executable, __file__, "--run", kind, str(size), str(out)]
    command += ["--threads", str(threads)]
    made = subprocess.run(command, capture_output=True, text=True, check=False)
    if made.returncode:
        sys.exit(f"{kind} at {size} unknowns failed:\n{made.stderr[-2000:]}")
    return [float(word) for word in made.stdout.split()]


def sizes(largest: int, threads: int, folder: Path) -> None:
    print(f"{'unknowns':>9s} {'solver':10s} {'s':>8s} {'MB':>7s} {'times':>7s} {'difference':>11s}")
    for size in MESHES:
        ours = folder / f"columns_{size}.npy"
        unknowns, seconds, memory = apart("columns", size, ours, threads)
        print(f"{unknowns:9.0f} {'columns':10s} {seconds:8.3f} {memory:7.0f}", flush=True)
        if size > largest:
            continue
        theirs = folder / f"sparse_{size}.npy"
        _, slow, much, assembled = apart("sparse", size, theirs, threads)
        difference = np.abs(np.load(ours) - np.load(theirs)).max()
        print(
            f"{unknowns:9.0f} {'sparse LU':10s} {slow:8.3f} {much:7.0f} {slow / seconds:7.0f} "
            f"{difference:11.1e}   (assembling it: {assembled:.1f} s more)",
            flush=True,
        )


def batch() -> None:
    generator = torch.Generator().manual_seed(0)
    random = torch.rand(100, 2, generator=generator, dtype=torch.float64)
    walls = torch.complex(0.2 + 3 * random[:, 0], 3 * random[:, 1] - 1.5)[:, None, None]
    frequency = torch.linspace(500, 2400, 20, dtype=torch.float64)
    mesh = mesh_of(17000)

    def together() -> torch.Tensor:
        solver = DuctSolver(CASE, frequency, mesh, keep="walls")
        return solver.solve(walls).wall_pressure(MICROPHONES)

    seconds, whole = best(together, 2)
    print(f"\n100 impedances x 20 frequencies, {mesh.unknowns} unknowns each, 18 microphones")
    each = 1e3 * seconds / 2000
    print(f"one batch                              {seconds:8.2f} s {each:9.3f} ms each")
    chosen = [(7 * i % 100, 3 * i % 20) for i in range(8)]

    def one_by_one() -> list[torch.Tensor]:
        return [
            solve_duct(CASE, frequency[f], walls[z], mesh, keep="walls").wall_pressure(MICROPHONES) for z, f in chosen
        ]

    slow, ones = best(one_by_one, 1)
    error = max(float((one[0] - whole[z, f]).abs().max()) for one, (z, f) in zip(ones, chosen, strict=True))
    each = slow / len(chosen)
    print(
        f"solve_duct for each (8 measured)       {2000 * each:8.0f} s {1e3 * each:9.3f} ms each, "
        f"{2000 * each / seconds:.0f} times; difference {error:.1e}"
    )
    solver = DuctSolver(CASE, frequency[:1], mesh, keep="walls")
    each, _ = best(lambda: [solver.solve(z).wall_pressure(MICROPHONES) for z in walls[:20]], 2)
    print(f"one DuctSolver, an impedance at a time {'':8s}   {1e3 * each / 20:9.3f} ms each, its sweep not counted")


def microphones() -> None:
    """Draws of the microphones' errors as one batch and one by one."""
    frequency = torch.linspace(500, 2400, 20, dtype=torch.float64)
    _draws("kumaresan_tufts", frequency, 500, 100, lambda line, _: tl.kumaresan_tufts(line))
    _draws("fit_field", frequency[10:11], 100, 4, tl.fit_field)


def _draws(name: str, frequency: torch.Tensor, draws: int, measured: int, educe: Callable[..., Any]) -> None:
    """All draws of a line as its leading axis, and some of them each as a line of its own."""
    solver = DuctSolver(CASE, frequency, keep="walls")
    over = MICROPHONES[3:15]
    pressure = solver.solve(IMPEDANCE).wall_pressure(over).movedim(-1, -2)
    noisy = draw_pressures(pressure, draws, torch.Generator().manual_seed(0))
    line = tl.MicrophoneLine(over, noisy, frequency, duct_height=HEIGHT, mach=0.3,
                             source_side="upstream")  # fmt: skip
    solvers = [DuctSolver(CASE, one[None], keep="walls") for one in frequency]
    count = draws * len(frequency)
    seconds, whole = best(lambda: educe(line, solver), 2)
    chosen = [(i % draws, i % len(frequency)) for i in range(measured)]

    def one_by_one() -> list[complex]:
        return [
            complex(educe(
                dataclasses.replace(line, pressure=noisy[d][:, f], frequency=frequency[f][None]),
                solvers[f],
            ).impedance[0])
            for d, f in chosen
        ]  # fmt: skip

    slow, ones = best(one_by_one, 1)
    error = max(abs(one - complex(whole.impedance[at])) for one, at in zip(ones, chosen, strict=True))
    each = slow / measured
    print(
        f"\n{name}, {draws} draws x {len(frequency)} frequencies, 12 microphones\n"
        f"one batch                              {seconds:8.2f} s {1e3 * seconds / count:9.3f} ms "
        f"each\none by one ({measured} measured)"
        f"{'':15s} {count * each:8.0f} s {1e3 * each:9.3f} ms each, {count * each / seconds:.0f} "
        f"times; difference {error:.1e}",
        flush=True,
    )


def settled() -> None:
    """What the checks of an answer cost, in seconds of a core: other work counts less."""
    works: dict[str, Callable[[], Any]] = {
        "one mesh": lambda: solve_duct(CASE, FREQUENCY, IMPEDANCE, keep="walls"),
        "search for a growing wave": lambda: growing_wave(CASE.profile, FREQUENCY, IMPEDANCE),
        "both, and a finer mesh": lambda: solve_settled(CASE, FREQUENCY, IMPEDANCE, places=MICROPHONES),
    }
    for name, work in works.items():
        work()
        start = time.process_time()
        work()
        print(f"{name:28s} {time.process_time() - start:6.2f} s of a core", flush=True)


def main(arguments: Sequence[str] | None = None) -> None:
    parser = parser_of(__doc__)
    parser.add_argument("--only", default="sizes,batch,microphones,settled")
    parser.add_argument("--largest", type=int, default=45000, help="unknowns of the sparse LU")
    parser.add_argument("--threads", type=int, default=1)
    parser.add_argument("--run", nargs=3, help=argparse.SUPPRESS)
    options = options_of(parser, arguments)
    torch.set_num_threads(options.threads)
    if options.run:
        kind, size, out = options.run
        {"columns": run_columns, "sparse": run_sparse}[kind](int(size), out)
        return
    load = os.getloadavg()[0] if hasattr(os, "getloadavg") else float("nan")
    print(
        f"{platform.machine()}, {os.cpu_count()} processors, {options.threads} thread(s), torch "
        f"{torch.__version__}; load of the machine before: {load:.1f}"
    )
    if "sizes" in options.only:
        with tempfile.TemporaryDirectory() as folder:
            sizes(options.largest, options.threads, Path(folder))
    if "batch" in options.only:
        batch()
    if "microphones" in options.only:
        microphones()
    if "settled" in options.only:
        settled()


if __name__ == "__main__":
    main()
