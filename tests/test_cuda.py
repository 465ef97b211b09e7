"""The same numbers on a GPU; skipped where there is none (``test_one_device.py`` proves the path without one)."""

import math
from typing import Any

import pytest
import torch
from torch import Tensor

import torchliner as tl
from torchliner.engine.nodes import Chebyshev, torch_sums

RATE, TONE = 42e3, 1400.0
CHOICES: list[dict[str, Any]] = [
    {},
    {"averaging": "admittance"},
    {"phase": "self-consistent", "minimum_coherence": 0.1},
    {"phase": "given", "reference_phase": 0.4},
    {"mean": "removed"},
    {"drive": "rms"},
    {"drive": "running-rms"},
    {"background": 1.0},
    {"wall_filter": 0.2},
]
needs_cuda = pytest.mark.skipif(not torch.cuda.is_available(), reason="no CUDA device")
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def plane(dtype: torch.dtype = torch.float64, device: str = "cpu") -> tl.VelocityPlane:
    """Turbulence and a tone over 3 x 40 probes, 20 periods."""
    generator = torch.Generator().manual_seed(0)
    v = 2 * torch.randn(3, 40, 600, generator=generator, dtype=torch.float64)
    v = v + 3 * torch.cos(2 * math.pi * TONE / RATE * torch.arange(600, dtype=torch.float64))
    x = 1e-3 * torch.arange(40, dtype=torch.float64)
    return tl.VelocityPlane(v.to(dtype).to(device), sampling_rate=RATE, frequency=TONE, x=x)


@needs_cuda
@pytest.mark.parametrize("choices", CHOICES, ids=str)
@pytest.mark.parametrize(("dtype", "limit"), [(torch.float64, 1e-10), (torch.float32, 2e-5)])
def test_device_does_not_matter(choices: dict[str, Any], dtype: torch.dtype, limit: float) -> None:
    """From data on either side."""
    liner = tl.load_liner("polito")
    wanted = tl.educe(plane(dtype), liner, **choices)
    for found in (
        tl.educe(plane(dtype), liner, device="cuda", **choices),
        tl.educe(plane(dtype, "cuda"), liner, **choices),
    ):
        for averaging in wanted.averagings:
            assert off(found.liner[averaging].reflection, wanted.liner[averaging].reflection) < limit
            assert off(found.cells[averaging].reflection, wanted.cells[averaging].reflection) < limit
            assert off(found.liner[averaging].low, wanted.liner[averaging].low) < 1e3 * limit


@needs_cuda
def test_moments_on_the_device_answer_like_the_plane() -> None:
    liner = tl.load_liner("polito")
    known = tl.moments(plane(), liner, device="cuda")
    assert off(known.educe(liner).answer, tl.educe(plane(), liner).answer) < 1e-10


@needs_cuda
def test_a_replayed_signal_is_that_of_the_cpu() -> None:
    liner = tl.load_liner("polito")
    for wave, about in ((TONE, {}), (tl.BandNoise(700, 2100), {"frequency": TONE, "segment": 0.005})):
        wanted, found = (tl.replay(plane(), liner, wave, device=device, **about) for device in ("cpu", "cuda"))
        assert off(found.answer, wanted.answer) < 1e-9


@needs_cuda
def test_a_file_is_read_onto_the_device(tmp_path: Any) -> None:
    plane().write(tmp_path / "plane.h5")
    lazy, liner = tl.read_plane(tmp_path / "plane.h5", lazy=True), tl.load_liner("polito")
    assert off(tl.educe(lazy, liner, device="cuda").answer, tl.educe(plane(), liner).answer) < 1e-10


@needs_cuda
def test_the_kernel_for_the_device_gives_the_sums_of_its_definition() -> None:
    generator = torch.Generator().manual_seed(0)
    v = 2 * torch.randn(3, 200, 1000, generator=generator)
    weights = torch.randn(3, 3, 200, generator=generator)
    wanted = torch_sums(weights.double(), v.double(), 32, 0.93)
    found = Chebyshev(32, 0.93).sums(weights.cuda(), v.cuda())
    assert found.device.type == "cuda"
    assert off(found, wanted) < 1e-3  # of sums of 200 terms in float32


@pytest.mark.skipif(torch.cuda.is_available(), reason="there is a CUDA device")
def test_a_device_that_does_not_exist_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match=r"'cuda:1' .* sees 0 CUDA devices"):
        tl.educe(plane(), tl.load_liner("polito"), device="cuda:1")


def off(found: Tensor | None, wanted: Tensor | None) -> float:
    assert found is not None
    assert wanted is not None
    return float((found.cpu() - wanted.cpu()).abs().max())
