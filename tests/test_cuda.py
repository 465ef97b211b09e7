"""The same numbers on a GPU; skipped where there is none."""

from __future__ import annotations

import pytest
import torch
from conftest import FREQUENCY, RATE, plane_of, turbulence

import torchliner as tl

pytestmark = [
    pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device"),
    pytest.mark.filterwarnings("ignore::torchliner.DataWarning"),
]


@pytest.mark.parametrize("engine", ["spectral", "direct"])
@pytest.mark.parametrize("drive", ["instantaneous", "running-rms"])
@pytest.mark.parametrize("phase", ["averaged", "self-consistent", "given"])
@pytest.mark.parametrize("edge", ["finite", "wrap"])
def test_device_does_not_matter(liner, engine, drive, phase, edge):
    """float64 on the GPU is float64 on the CPU to 1e-12, from data on either side."""
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
        assert float((found.reflection.cpu() - wanted.reflection).abs().max()) < 1e-12
        cells = found.cell_reflection.cpu() - wanted.cell_reflection
        assert float(cells.abs().max()) < 1e-12


@pytest.mark.parametrize("dtype", ["float32", "float64"])
def test_maps_from_a_gpu_are_written(liner, tmp_path, dtype):
    """A map on the device goes to file and picture."""
    found = tl.educe(plane_of(turbulence((3, 4, 480))), liner, device="cuda", dtype=dtype)
    found.write(tmp_path / "m.h5")
    found.plot(tmp_path / "m.png")
    read = tl.read_map(tmp_path / "m.h5")
    assert float((read.reflection - found.reflection.cpu()).abs().max()) == 0
