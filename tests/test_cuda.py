"""The same numbers on a GPU; skipped where there is none."""

from __future__ import annotations

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence
from test_stations import station

import torchliner as tl

pytestmark = [
    pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device"),
    pytest.mark.filterwarnings("ignore::torchliner.DataWarning"),
]


@pytest.mark.parametrize("engine", ["spectral", "unfold", "direct"])
@pytest.mark.parametrize("drive", ["instantaneous", "running-rms"])
@pytest.mark.parametrize("phase", ["averaged", "self-consistent", "given"])
@pytest.mark.parametrize("edge", ["finite", "wrap"])
def test_device_does_not_matter(liner, engine, drive, phase, edge):
    """float64 on the GPU is float64 on the CPU to rounding, from data on either side."""
    t = torch.arange(480, dtype=torch.float64) / RATE
    v = turbulence((3, 4, 480)) + 3 * torch.cos(2 * torch.pi * FREQUENCY * t)
    options = {"engine": engine, "drive": drive, "phase": phase, "edge": edge}
    if phase == "given":
        options["reference_phase"] = 0.4
    wanted = tl.educe(plane_of(v), liner, **options)
    for found in (
        tl.educe(plane_of(v), liner, device="cuda", **options),
        tl.educe(plane_of(v.cuda()), liner, **options),
    ):
        assert found.reflection.device.type == "cuda"
        limit = 1e-10 if engine == "unfold" else 1e-12
        assert float((found.reflection.cpu() - wanted.reflection).abs().max()) < limit
        cells = found.cell_reflection.cpu() - wanted.cell_reflection
        assert float(cells.abs().max()) < limit


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_maps_from_a_gpu_are_written(liner, tmp_path, dtype):
    """A map on the device goes to file and picture."""
    found = tl.educe(plane_of(turbulence((3, 4, 480))), liner, device="cuda", dtype=dtype)
    found.write(tmp_path / "m.h5")
    found.plot(tmp_path / "m.png")
    read = tl.read_map(tmp_path / "m.h5")
    assert float((read.reflection - found.reflection.cpu()).abs().max()) == 0


@pytest.mark.parametrize("engine", ["spectral", "unfold"])
def test_streamed_through_pinned_memory(liner, tmp_path, engine):
    """A file in slabs of a few samples: no slab is overwritten before it has been copied."""
    plane = plane_of(turbulence((40, 480)).to(torch.float32))
    plane.write(tmp_path / "p.h5")
    wanted = tl.educe(plane, liner, engine=engine)
    lazy = tl.read_plane(tmp_path / "p.h5", lazy=True)
    found = tl.educe(lazy, liner, engine=engine, device="cuda", memory=(1 << 26) + 60_000)
    assert float((found.reflection.cpu() - wanted.reflection).abs().max()) < 2e-5


@pytest.mark.parametrize("edge", ["finite", "wrap"])
@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_compiled_for_a_gpu(liner, edge, dtype):
    """Formula and table, fused: the eager numbers."""
    plane = plane_of(turbulence((300, 480)))
    wanted = tl.educe(plane, liner, edge=edge)
    found = tl.educe(plane, liner, edge=edge, device="cuda", dtype=dtype, compile="always")
    limit = 1e-12 if dtype == "float64" else 1e-6
    assert float((found.reflection.cpu() - wanted.reflection).abs().max()) < limit


@pytest.mark.parametrize("incident", ["noise:300:3500", "sweep:300:3500", "tones:500,900"])
def test_signals_on_a_gpu(liner, incident):
    """Broadband estimates do not hang on the device."""
    plane = plane_of(turbulence((5, 840)))
    wanted = tl.educe(plane, liner, incident=incident)
    found = tl.educe(plane, liner, incident=incident, device="cuda")
    assert float((found.reflection.cpu() - wanted.reflection).abs().max()) < 1e-9


def test_a_line_of_stations_is_the_same_on_the_gpu(liner):
    """Bursts are gridded on the CPU; their segments are replayed on the device."""
    records = [station(seed) for seed in range(2)]
    choices = {"segment": 0.04, "phase": "self-consistent"}
    here, there = (tl.educe_bursts(records, liner, device=d, **choices) for d in ("cpu", "cuda"))
    assert there.reflection.device.type == "cpu"
    assert float((here.reflection - there.reflection).abs().max()) < 1e-10
    assert float((here.interval.low - there.interval.low).abs().max()) < 1e-8


def test_wall_pressures_on_a_gpu():
    """Prediction, fits and draws of a line on the device are those on the CPU."""
    x = torch.arange(12, dtype=torch.float64) * 0.012
    walls = torch.tensor([1.5 + 0.3j, 2.33 - 0.3j], dtype=torch.complex128)
    about = {"height": 0.05, "mach": 0.3}
    alpha, beta = (
        tl.wavenumber_from_impedance(walls, [1000.0, 1500.0], direction=d, **about) for d in ("downstream", "upstream")
    )
    place = x[:, None]
    pressure = torch.exp(-1j * alpha * place) + 0.3 * torch.exp(-1j * beta * (place - x[-1]))
    there, here = (
        tl.MicrophoneLine(x, values, [1000.0, 1500.0], duct_height=0.05, mach=0.3,
                          source_side="upstream")
        for values in (pressure.cuda(), pressure)
    )  # fmt: skip
    for method in (tl.kumaresan_tufts, tl.two_wave_fit):
        found, wanted = (method(line, draws=20) for line in (there, here))
        assert found.impedance.device.type == "cuda"
        assert float((found.impedance.cpu() - wanted.impedance).abs().max()) < 1e-9
        drawn = found.draws.impedance.cpu() / wanted.draws.impedance - 1
        assert float(drawn.abs().max()) < 1e-6
    found = tl.wavenumber_from_impedance(walls.cuda(), [1000.0, 1500.0], **about)
    assert float((found.cpu() - alpha).abs().max()) < 1e-11
    level = tl.sort_waves(there, [0, 4]).incident_level.cpu()
    assert float((level - tl.sort_waves(here, [0, 4]).incident_level).abs().max()) < 1e-9
