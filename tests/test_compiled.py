"""The fused loop: the eager numbers, or one warning and the eager numbers."""

from __future__ import annotations

import shutil
import warnings

import pytest
import torch
from conftest import FREQUENCY, RATE, turbulence
from test_replay import Held, make_record

from torchliner.replay import compiled
from torchliner.replay.spectral import response_of, spectral_sums


def run(liner, speed, window="hann", **options):
    record = make_record(speed.shape[1], window, "wrap")
    frequency = torch.tensor([FREQUENCY], dtype=torch.float64)
    response = response_of(liner, record.line_frequencies(FREQUENCY)[0], None, None)
    return spectral_sums(Held(speed), [response], frequency, record, [None], None,
                         backward=True, **options)  # fmt: skip


@pytest.fixture(autouse=True)
def _fresh():
    compiled.compile_line_sums.cache_clear()
    yield
    compiled.compile_line_sums.cache_clear()


@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_fused_formula_is_the_eager_one(liner, dtype):
    """Uncompiled, the fused function gives the same sums: also with a padded last slab."""
    speed = turbulence((5, 330), seed=1).abs().to(dtype)
    wanted = run(liner, speed)
    monkey = pytest.MonkeyPatch()
    with monkey.context() as patch:
        patch.setattr(torch, "compile", lambda function, **_: function)
        found = run(liner, speed, compiled=True, slab_rows=64)
    scale = float(wanted.forward.abs().max())
    limit = 1e-13 if dtype == torch.float64 else 1e-6
    assert float((found.forward - wanted.forward).abs().max()) < limit * scale
    assert float((found.backward - wanted.backward).abs().max()) < limit * scale


def test_no_compiler_is_one_warning_and_the_same_numbers(liner, monkeypatch):
    """A failing compile is caught on a tiny warm-up; the second call does not even try."""
    tried = []

    def broken(function, **_):
        tried.append(function)

        def fail(*_):
            raise RuntimeError("InvalidCxxCompiler: no working C++ compiler")

        return fail

    monkeypatch.setattr(torch, "compile", broken)
    speed = turbulence((2, 300), seed=2).abs()
    with pytest.warns(RuntimeWarning, match="no working C\\+\\+ compiler.*same numbers"):
        found = run(liner, speed, compiled=True)
    assert torch.equal(found.forward, run(liner, speed).forward)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        run(liner, speed, compiled=True)
    assert len(tried) == 1


def test_small_jobs_never_compile(liner, monkeypatch):
    """A plane of a thousand samples does not wait for a compiler."""

    def never(*_, **__):
        raise AssertionError("compiled")

    monkeypatch.setattr(torch, "compile", never)
    assert run(liner, turbulence((3, 300)).abs()).forward.shape == (3, 1)
    assert RATE * 1e3 < compiled.PAYS_FROM


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("g++") is None, reason="no C++ compiler here")
def test_really_compiled(liner):
    """With a compiler: float64 to rounding."""
    speed = turbulence((64, 512), seed=3).abs()
    wanted = run(liner, speed, "boxcar")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # torch's own, while it compiles
        found = run(liner, speed, "boxcar", compiled=True)
    assert compiled.compile_line_sums.cache_info().currsize == 1
    assert float((found.forward - wanted.forward).abs().max() / wanted.forward.abs().max()) < 1e-12
