"""Intervals: laws of the jackknife, bounds near the pole, and the error bars of maps."""

import math
import warnings
from itertools import pairwise

import pytest
import torch
from conftest import FREQUENCY, RATE, load_script, plane_of, turbulence
from scipy.special import stdtrit
from torch import Tensor

import torchliner as tl
from torchliner.conversions import impedance_from_reflection
from torchliner.engine.intervals import FROM_REFLECTION, ITSELF, impedance_interval, jackknife, replicates
from torchliner.records.educed import Interval

SAMPLES = round(20 * RATE / FREQUENCY)


@pytest.mark.parametrize("drive", ["instantaneous", "rms", "running-rms"])
def test_interval_holds_its_value(liner, drive):
    found = tl.educe(plane_of(turbulence((6, SAMPLES)), x=[0.001 * i for i in range(6)]), liner, drive=drive)
    for each in (*found.probes.values(), *found.cells.values(), *found.liner.values(), *found.along_x.values()):
        # At this rms the reactance of the liner has a minimum: first-order bounds miss it.
        for part in ("real",) if drive == "rms" else ("real", "imag"):
            low, middle, high = (getattr(z, part) for z in (each.interval.low, each.impedance, each.interval.high))
            assert (low < middle).all()
            assert (middle < high).all()
            width = (high - low) / getattr(each.interval.standard_error, part)
            assert (width > 3.5).all()
            if drive != "running-rms":  # whose blocks are fewer independent ones: Student's quantile of 3 runs is 4.3
                assert (width < 7).all()


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
@pytest.mark.parametrize(("name", "trials"), [("liner of 8 cells", 60), ("liner of 200", 100)])
def test_intervals_hold_the_known_value(name, trials):
    """Of 1 kHz noise, 16 periods: 480 probes and cells (standard error 1 %), 60 and 100 liners (3 %)."""
    script = load_script("coverage")
    rows = [*script.rows_of(name, "1 kHz noise", 16, trials)]
    assert {row["v"] for row in rows} == {"no tone", "tone"}
    for row in rows:
        for part in "RX":
            assert row[f"{part} inside (%)"] > (91.5 if row["trials"] >= 400 else 86), row


@pytest.mark.parametrize("averaging", ["admittance", "velocity", "phase-locked"])
def test_a_record_of_one_block_has_no_interval(liner, averaging, tmp_path):
    v = turbulence((2, 40))
    choices = {"allow_short": True, "averaging": averaging}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = tl.educe(plane_of(v), liner, **choices)
        tl.moments(plane_of(v), liner, **choices).write(tmp_path / "m.h5")
        again = tl.read_moments(tmp_path / "m.h5").educe(liner, **choices)
    assert found.level is None
    assert torch.allclose(found.answer, again.answer, rtol=1e-8, atol=0)
    if averaging == "admittance":
        z = liner.impedance(FREQUENCY, v[:, :30].abs())
        wanted = ((z - 1) / (z + 1)).mean(1)
        assert float((found.probes["admittance"].reflection[:, 0] - wanted).abs().max()) < 1e-8


COUNTS = (4, 5, 8, 16, 32)  # blocks


def blocks_of(count: int, columns: int, rho: float = 0.0) -> Tensor:
    """Means of blocks that scatter by 1 in both parts, as a first-order process along time, complex128, (S, N)."""
    white = torch.randn(count, columns, 2, dtype=torch.float64)
    found = [white[0]]
    for each in white[1:]:
        found.append(rho * found[-1] + math.sqrt(1 - rho**2) * each)
    return torch.view_as_complex(torch.stack(found))


def means_of(blocks: Tensor, lengths: Tensor | None = None) -> tuple[Tensor, Tensor]:
    """Means over the remaining blocks, and the shares of the blocks; of equal lengths unless stated."""
    lengths = torch.ones(len(blocks), dtype=torch.float64) if lengths is None else lengths
    return replicates(blocks * lengths[:, None], lengths), lengths / lengths.sum()


def interval_of(blocks: Tensor, level: float = 0.95) -> Interval:
    return jackknife(*means_of(blocks), level, ITSELF)


def defined_error(own: list[complex], runs: float) -> complex:
    """Standard errors of both parts by the definition, number by number, from what each block contributes."""
    count, variances = len(own), []
    power = sum(abs(u) ** 2 for u in own)
    rho = sum((u * v.conjugate()).real for u, v in pairwise(own)) / power
    rho = min(0.9, max(-0.9, rho + (1 + 4 * rho) / count))
    length = max(2, min(count // 4, math.ceil(1.1447 * (4 * rho**2 * count / (1 - rho**2) ** 2) ** (1 / 3))))
    assert runs == pytest.approx(count / length)
    for part in ([u.real for u in own], [u.imag for u in own]):
        squares = [sum(part[i : i + length]) ** 2 for i in range(count - length + 1)]
        variances.append(count / length * count / (count - length) * sum(squares) / len(squares))
    shown = 1 + 2 * sum((1 - k / length) * rho**k for k in range(1, length))  # of the correlation, by a run
    return complex(*(math.sqrt(variance * (1 + rho) / (1 - rho) / shown) for variance in variances))


@pytest.mark.parametrize("count", COUNTS)
@pytest.mark.parametrize("rho", [-0.6, 0.0, 0.6])
def test_the_error_of_a_mean_is_that_of_its_runs_whatever_the_blocks(count: int, rho: float) -> None:
    blocks, lengths = blocks_of(count, 5, rho), 100 + 10.0 * torch.randint(0, 5, (count,)).double()
    means, shares = means_of(blocks, lengths)
    found, own = jackknife(means, shares, 0.95, ITSELF), (shares[:, None] * (blocks - means[0])).T.tolist()
    expected = [defined_error(each, float(runs)) for each, runs in zip(own, found.runs, strict=True)]
    torch.testing.assert_close(found.standard_error, torch.tensor(expected, dtype=torch.complex128))
    torch.testing.assert_close(found.bias, torch.zeros_like(found.bias), atol=1e-13, rtol=0)  # a mean has none


@pytest.mark.parametrize(("count", "least", "most"), [(4, 98, 100), (8, 96, 97.5), (16, 95, 97), (32, 94.5, 96.5)])
def test_of_white_noise_the_variance_is_right_and_intervals_hold_the_truth(
    count: int, least: float, most: float
) -> None:
    found = interval_of(blocks_of(count, 20000))
    squares = torch.view_as_real(found.standard_error).square() * count
    spread = 3 * float(squares.std()) / math.sqrt(squares.numel())
    # Allowing for the correlation that a record seems to have adds some of its scatter, of order 1/S.
    assert 1 - spread < float(squares.mean()) < 1 + spread + 1.5 / count
    assert least < 100 * float(((found.low.real <= 0) & (found.high.real >= 0)).double().mean()) < most


@pytest.mark.parametrize("level", [0.5, 0.95, 0.999])
@pytest.mark.parametrize("count", COUNTS)
def test_half_a_width_is_students_quantile_times_the_standard_error(count: int, level: float) -> None:
    found = interval_of(blocks_of(count, 50, 0.5), level)
    quantile = torch.from_numpy(stdtrit((found.runs - 1).numpy(), 0.5 + level / 2))
    torch.testing.assert_close(found.widths, 2 * quantile * torch.view_as_real(found.standard_error).T)


def test_a_square_is_off_by_the_variance_and_the_bounds_are_without_it() -> None:
    means, shares = means_of(blocks_of(16, 40000).real.to(torch.complex128) + 3)
    found = jackknife(means**2, shares, 0.95, ITSELF)
    torch.testing.assert_close(((found.low + found.high) / 2 + found.bias).real, means[0].real ** 2)
    assert float(found.bias.real.mean()) == pytest.approx(1 / 16, rel=0.05)


def test_bounds_are_the_extremes_on_the_ellipse_and_infinite_around_the_pole() -> None:
    value = 1 + 0.3 * torch.randn(400, dtype=torch.complex128)
    long, turn, quantile = (torch.rand(400, dtype=torch.float64) for _ in range(3))
    turned = torch.exp(2j * math.pi * turn)
    axes = torch.stack([long * turned, 0.3j * long * turned])  # R = value + quantile (axes times cos, sin)
    scatter = axes.abs().square().sum(0), axes.square().sum(0)
    found = impedance_interval(value, 0 * value, *scatter, quantile, quantile, FROM_REFLECTION)
    pole = (1 - value) / turned / (quantile * long)  # from the middle, in half axes
    away = pole.real**2 + (pole.imag / 0.3) ** 2
    assert 40 < int((away < 1).sum()) < 200
    assert torch.equal(found.widths == math.inf, (away < 1).expand(2, -1))
    angle = 2 * math.pi / 10000 * torch.arange(10000, dtype=torch.float64)
    around = axes.T @ torch.stack([angle.cos(), angle.sin()]).to(axes)
    z = impedance_from_reflection(value[:, None] + quantile[:, None] * around)
    least, most = torch.view_as_real(z).aminmax(dim=1)
    for end, expected in ((found.low, least), (found.high, most)):
        off = (torch.view_as_real(end) - expected) / (most - least)
        assert float(off[away > 2].abs().max()) < 1e-3


def test_blocks_that_do_not_vary_give_no_width_and_a_rigid_wall_no_bounds() -> None:
    lengths = torch.tensor([30.0, 31, 29, 30, 30, 33, 30, 30], dtype=torch.float64)
    still = jackknife(*means_of(torch.full((8, 3), 0.3 + 0.2j, dtype=torch.complex128), lengths), 0.95)
    assert float(still.widths.abs().max()) < 1e-12
    wall = jackknife(*means_of(torch.ones(8, 3, dtype=torch.complex128)), 0.95)
    assert bool((wall.widths == math.inf).all())
