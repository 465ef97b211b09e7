"""The fused loops: the eager numbers, or one warning and the eager numbers."""

from __future__ import annotations

import shutil
import warnings

import pytest
import torch
from conftest import FREQUENCY, RATE, turbulence
from test_replay import GRID, make_record

from torchliner.replay import compiled
from torchliner.replay.kernels import build_kernels
from torchliner.replay.lines import plan_lines
from torchliner.reduction.sources import Columns, HeldSpeed
from torchliner.replay.spectral import spectral_sums

KINDS = ("formula", "table", "formula and ends")


class Shifted(HeldSpeed):
    """Signed velocity with a mean to be taken off."""

    def slabs(self, bounds):
        for slab in super().slabs(bounds):
            velocity = slab[0].velocity
            yield [Columns(velocity, torch.linspace(-1, 1, velocity.shape[1]).to(velocity))]


def run(liner, velocity, window="hann", kind="formula", source=HeldSpeed, **options):
    record = make_record(velocity.shape[1], window, "finite" if "ends" in kind else "wrap")
    kernels = None if kind == "formula" else build_kernels(liner, GRID, RATE)
    lines = plan_lines(liner, [FREQUENCY], record, GRID, kernels, of_kernel=kind == "table")
    return spectral_sums(source(velocity), lines, GRID, **options)


@pytest.fixture(autouse=True)
def _fresh():
    compiled.compile_loop.cache_clear()
    compiled.failures.clear()
    yield
    compiled.compile_loop.cache_clear()
    compiled.failures.clear()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("source", [HeldSpeed, Shifted])
def test_fused_loops_are_the_eager_ones(liner, dtype, kind, source, monkeypatch):
    """Uncompiled, the fused functions give the same sums: also with a padded last slab."""
    velocity = turbulence((5, 330), seed=1).to(dtype)
    wanted = run(liner, velocity, kind=kind, source=source, compile_loops="never")
    monkeypatch.setattr(torch, "compile", lambda function, **_: function)
    found = run(liner, velocity, kind=kind, source=source, compile_loops="always")
    scale = float(wanted.forward.abs().max())
    limit = 1e-13 if dtype == torch.float64 else 2e-6
    assert float((found.forward - wanted.forward).abs().max()) < limit * scale
    assert float((found.backward - wanted.backward).abs().max()) < limit * scale


def test_no_compiler_is_one_warning_and_the_same_numbers(liner, monkeypatch):
    """A failing compile is caught on a warm-up; other shapes do not warn again."""
    tried = []

    def broken(function, **_):
        tried.append(function)

        def fail(*_):
            raise RuntimeError("InvalidCxxCompiler: no working C++ compiler")

        return fail

    monkeypatch.setattr(torch, "compile", broken)
    speed = turbulence((2, 300), seed=2).abs()
    with pytest.warns(RuntimeWarning, match="no working C\\+\\+ compiler.*same numbers"):
        found = run(liner, speed, compile_loops="always")
    assert torch.equal(found.forward, run(liner, speed, compile_loops="never").forward)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(liner, speed, compile_loops="always")
        assert len(tried) == 1
        run(liner, speed[:1], kind="table", compile_loops="always")


def test_small_jobs_never_compile(liner, monkeypatch):
    """A plane of a thousand samples does not wait for a compiler."""

    def never(*_, **__):
        raise AssertionError("compiled")

    monkeypatch.setattr(torch, "compile", never)
    assert run(liner, turbulence((3, 300)).abs()).forward.shape == (3, 1)
    assert RATE * 1e3 < compiled.PAYS_FROM


def test_laws_beyond_single_precision_are_summed_in_double(liner):
    """At 0.01 Hz the formula's squares leave float32; the sums do not."""

    record = make_record(300, "boxcar", "wrap")
    speed = torch.linspace(0, 4, 300).repeat(2, 1)
    found = {}
    for dtype in (torch.float32, torch.float64):
        lines = plan_lines(liner, [1e-2], record, GRID)
        found[dtype] = spectral_sums(HeldSpeed(speed.to(dtype)), lines, GRID).forward
    assert bool(torch.isfinite(found[torch.float32].abs()).all())
    assert float((found[torch.float32] - found[torch.float64]).abs().max()) < 1e-4


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler here")
@pytest.mark.parametrize(("kind", "shapes"), [("formula", range(1, 11)), ("table", [64])])
def test_really_compiled(liner, kind, shapes):
    """With a compiler: float64 to rounding, and more shapes than torch recompiles one function."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch's own, while it compiles
        for probes in shapes:
            speed = turbulence((probes, 512), seed=3).abs()
            wanted = run(liner, speed, "boxcar", kind=kind, compile_loops="never")
            found = run(liner, speed, "boxcar", kind=kind, compile_loops="always")
            error = (found.forward - wanted.forward).abs().max() / wanted.forward.abs().max()
            assert float(error) < 1e-12
    assert not compiled.failures
    assert compiled.compile_loop.cache_info().currsize == len(shapes)
