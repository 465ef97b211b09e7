"""Error bars: block means, intervals, coverage, files and doubts."""

from __future__ import annotations

import csv
import dataclasses
import itertools
import json
import math
import re
import threading
import warnings

import numpy as np
import pytest
import torch
from conftest import DATA, FREQUENCY, RATE, frozen_plane, load_script, plane_of, turbulence
from torchliner.compiled.threads import in_order
from torchliner.replay.incident import Means
from torchliner.replay.kernels import build_kernels
from torchliner.replay.levels import VelocityGrid, interpolate
from torchliner.tdibc import intervals
from torchliner.tdibc.block_deviations import block_deviations
from torchliner.tdibc.educe import replay
from torchliner.tdibc.prepare import prepare

import torchliner as tl
from torchliner.cli.main import main
from torchliner.velocity.choices import Choices

PERIODS = 20
SAMPLES = round(PERIODS * RATE / FREQUENCY)


@pytest.fixture
def noisy() -> tl.VelocityPlane:
    return plane_of(turbulence((6, SAMPLES)), x=[0.001 * i for i in range(6)])


class Table:
    """A user's liner without a formula."""

    def __init__(self, liner: tl.SDoFLiner) -> None:
        self.inner = liner

    def impedance(self, frequency, speed):
        return self.inner.impedance(frequency, speed)


# Parts of the probes, several at once


@pytest.mark.parametrize("order", ["admittance", "phase-locked"])
def test_error_bars_know_no_parts_and_no_threads(monkeypatch, liner, order, set_threads):
    plane = plane_of(turbulence((23, SAMPLES)), x=[0.001 * i for i in range(23)])
    whole = tl.educe(plane, liner, [FREQUENCY, 900.0], averaging=order).uncertainty
    monkeypatch.setattr(intervals, "ELEMENTS", 7 * 20)
    found = []
    for threads in (3, 1):
        set_threads(threads)
        found.append(tl.educe(plane, liner, [FREQUENCY, 900.0], averaging=order).uncertainty)
        assert torch.get_num_threads() == threads
    for name in ("probes", "cells", "liner", "liner_coherent_first"):
        if getattr(whole, name) is None:
            assert (name, order) == ("liner_coherent_first", "admittance")
            continue
        for one, other in zip(vars(getattr(whole, name)).values(),
                              vars(getattr(found[0], name)).values(), strict=True):  # fmt: skip
            torch.testing.assert_close(other, one, rtol=1e-6, atol=1e-9)
        for one, other in zip(*(vars(getattr(each, name)).values() for each in found), strict=True):
            assert torch.equal(one, other)


@pytest.mark.parametrize("drive", ["instantaneous", "rms"])
def test_a_liner_of_the_user_knows_one_thread(monkeypatch, liner, drive, set_threads):
    class Own(Table):
        def impedance(self, frequency, speed):
            callers.add(threading.get_ident())
            return super().impedance(frequency, speed)

    callers = set()
    set_threads(3)
    monkeypatch.setattr(intervals, "ELEMENTS", 7 * 20)
    plane = plane_of(turbulence((23, SAMPLES)), x=[0.001 * i for i in range(23)])
    tl.educe(plane, Own(liner), drive=drive)
    assert callers == {threading.get_ident()}


def test_work_in_threads_keeps_its_order_and_its_errors(set_threads):
    begun, done = [], []
    set_threads(3)

    def root(item):
        assert not torch.is_grad_enabled()
        return math.sqrt(item)

    def items():
        for item in range(20):
            begun.append(item)
            yield item

    def use(result):
        done.append(result)
        assert len(begun) - len(done) <= 3  # no more is held than is worked on

    in_order(root, items(), use)
    assert done == [math.sqrt(item) for item in range(20)]
    for work, problem in ((root, ValueError), (lambda item: item, ZeroDivisionError)):
        with pytest.raises(problem):
            in_order(work, [4, -1, 9], lambda result: 1 / (result - 4))
        assert torch.get_num_threads() == 3
    in_order(root, [], done.append)
    assert len(done) == 20


# Blocks


@pytest.mark.parametrize("kind", ["formula", "user", "kernel"])
def test_block_means_are_means_of_the_response(noisy, liner, kind):
    """The pass over the data keeps the mean of R, and of R e^{-2 j w t}, of every block."""
    model = Table(liner) if kind == "user" else liner
    choices = {"kernel": "causal"} if kind == "kernel" else {}
    plane = dataclasses.replace(noisy, velocity=turbulence((6, 1500)))  # no whole slabs, blocks
    chosen = Choices(**choices)
    ready = prepare([plane], model, [FREQUENCY, 900.0], chosen, every_rule=True)[0]
    found = ready.block_means(slice(0, 6))
    time = torch.arange(plane.samples, dtype=torch.float64) / RATE
    for f, frequency in enumerate((FREQUENCY, 900.0)):
        if kind == "kernel":
            at = torch.tensor([frequency], dtype=torch.float64)
            levels = VelocityGrid(20.0, 1000)
            table = build_kernels(liner, levels, RATE, kind="causal", band=ready.kernels.band)
            response = interpolate(table.response(at)[:, 0], *levels.locate(plane.velocity.abs()))
        else:
            z = liner.impedance(frequency, plane.velocity.abs())
            response = tl.reflection_from_impedance(z)
        turning = torch.exp(-4j * torch.pi * frequency * time)
        for s, (begin, end) in enumerate(itertools.pairwise(ready.blocks.borders)):
            part = slice(begin, end)
            wanted = response[:, part].mean(1), (response * turning)[:, part].mean(1)
            for mine, right in zip((found.forward, found.backward), wanted, strict=True):
                error = (mine[s, :6, f] - right).abs().max()
                assert error < (1e-5 if kind == "kernel" else 1e-9)  # of the basis, chosen for R


# Intervals


@pytest.mark.parametrize("phase", ["averaged", "self-consistent", "given"])
def test_frozen_velocity_leaves_no_doubt(liner, phase):
    """With |v| constant nothing fluctuates, so both bounds are the model's Z."""
    choices = {"reference_phase": 0.3} if phase == "given" else {}
    found = tl.educe(frozen_plane(2.0, periods=20), liner, phase=phase, minimum_coherence=0.0, **choices)
    for name in ("probes", "cells", "cells_velocity_first", "liner", "liner_velocity_first"):
        interval = getattr(found.uncertainty, name)
        assert (interval.high - interval.low).abs().max() < 1e-9
    assert (found.liner["admittance"].interval.low - found.liner["admittance"].impedance).abs().max() < 1e-9


@pytest.mark.parametrize("drive", ["instantaneous", "rms", "running-rms"])
def test_interval_holds_its_value(noisy, liner, drive):
    """The educed value lies within its own bounds, and the error is some fraction of the width."""
    found = tl.educe(noisy, liner, drive=drive)
    for value, interval in (
        (found.impedance, found.probes["admittance"].interval),
        (found.cells["admittance"].impedance, found.cells["admittance"].interval),
        (found.cells["velocity"].impedance, found.cells["velocity"].interval),
        (found.liner["admittance"].impedance, found.liner["admittance"].interval),
    ):
        # At this rms the reactance of the liner has a minimum: first-order bounds miss it.
        for part in ("real",) if drive == "rms" else ("real", "imag"):
            low, middle, high = (getattr(z, part) for z in (interval.low, value, interval.high))
            assert (low < middle).all()
            assert (middle < high).all()
            errors = getattr(interval.standard_error, part)
            width = (high - low) / errors
            assert (width > 3.5).all()
            if drive == "instantaneous" or part == "real":  # an error of first order is none there
                assert (width < 7).all()


@pytest.mark.parametrize("resample", ["time", "time-span"])
@pytest.mark.parametrize("rows", [2, 4, 12])
def test_averages_of_copies_are_known_as_well_as_one(liner, rows, resample):
    """Probes that all see the same eddies are one observation, along z too, and have no bias."""
    velocity = turbulence((1, 100 * 30)).expand(rows, 2, -1).clone()
    plane = plane_of(velocity, z=[0.02 * i for i in range(rows)], x=[0.0, 1e-3])
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        found = tl.educe(plane, liner, resample=resample).uncertainty
    for name in ("liner", "along_x", "cells"):
        interval = getattr(found, name)
        first = [value.reshape(-1)[0] for value in vars(interval).values()]
        one = [value.reshape(-1)[0] for value in vars(found.probes).values()]
        assert all(abs(a - b) < 1e-9 for a, b in zip(first, one, strict=True)), name
    assert found.settings["resampled"] == "time"


def test_mean_of_admittances_of_short_records_is_biased(liner):
    """Y is not linear in R: its mean over many short records is off the same way for all."""
    records = turbulence((1, 400 * 16 * 30)).reshape(400, 16 * 30)
    choices = {"velocity_max": 20.0, "edge": "wrap", "window": "boxcar"}
    found = tl.educe(plane_of(records), liner, **choices)
    wanted = tl.educe(plane_of(records.reshape(1, -1)), liner, **choices)
    truth = complex(wanted.impedance[0, 0])
    off = complex(found.liner["admittance"].impedance[0]) - truth
    interval = found.liner["admittance"].interval
    assert abs(complex(interval.bias[0]) - off) < 0.25 * abs(off)
    low, high, error = (complex(z[0]) for z in (interval.low, interval.high, interval.standard_error))
    assert low.real < truth.real < high.real
    assert low.imag < truth.imag < high.imag
    assert abs(off.imag) > 1.5 * error.imag
    assert found.probes["admittance"].interval.bias.abs().max() == 0
    assert any("off by about" in note for note in found.notes)


def test_averages_of_independent_probes_are_known_better(liner):
    """Sixteen independent probes: the mean admittance is known four times better."""
    found = tl.educe(plane_of(turbulence((16, 40 * 30))), liner).uncertainty
    single = float(found.probes.standard_error.real.median())
    assert float(found.liner.standard_error[0].real) == pytest.approx(single / 4, rel=0.5)


def test_interval_does_not_hang_on_neighbours_or_memory(noisy, liner):
    """Alone, among others, in small slabs or by another engine: the same bounds."""
    whole = tl.educe(noisy, liner, velocity_max=20.0).probes["admittance"].interval
    single = dataclasses.replace(noisy, velocity=noisy.velocity[2:3], x=noisy.x[2:3])
    alone = tl.educe(single, liner, velocity_max=20.0).probes["admittance"].interval
    assert (alone.low[0] - whole.low[2]).abs().max() < 1e-12
    small = tl.educe(noisy, liner, velocity_max=20.0, memory=(1 << 26) + 12000).probes["admittance"].interval
    assert (small.high - whole.high).abs().max() < 1e-8  # of sums that end elsewhere
    for engine in ("unfold", "direct"):
        other = tl.educe(noisy, liner, velocity_max=20.0, engine=engine).probes["admittance"].interval
        # Of a Hann window over the reflected signal, with the scatter of weight 1.
        own = tl.educe(noisy, liner, velocity_max=20.0, window="hann").probes["admittance"].interval
        assert (other.low - own.low).abs().max() < 2e-2


def test_level(noisy, liner):
    """Nothing is drawn: the same bounds again; a higher level gives wider ones."""
    first = tl.educe(noisy, liner).liner["admittance"].interval
    again = tl.educe(noisy, liner).liner["admittance"].interval
    wide = tl.educe(noisy, liner, interval=0.99).liner["admittance"].interval
    assert torch.equal(first.low, again.low)
    assert wide.low.real < first.low.real < first.high.real < wide.high.real


@pytest.mark.parametrize("rule", ["averaged", "given", "self-consistent"])
def test_deviations_are_the_slope_of_the_rule(liner, rule):
    """Pushing the means a little way towards one block moves R as the deviation says."""
    time = torch.arange(SAMPLES, dtype=torch.float64) / RATE
    tone = 2.0 * torch.cos(2 * torch.pi * FREQUENCY * time + 0.4)
    plane = plane_of(tone + 0.5 * turbulence((3, SAMPLES)))
    ready = prepare([plane], liner, None, Choices(phase=rule, edge="wrap"))[0]
    replayed = replay(ready)
    means = replayed.means
    known = replayed.rule(rule, 0.7 if rule == "given" else None)
    moved = block_deviations(ready, known, means)(slice(0, 3))
    every = slice(0, len(means.a))
    blocks, seen, step, block = ready.block_means(every), ready.survey.blocks, 1e-6, 5

    def reflection(amount: float) -> torch.Tensor:
        def push(series: torch.Tensor) -> torch.Tensor:
            return amount * (series[block] - series.mean(0))

        a = means.a + push(blocks.forward)
        b = None if means.b is None else means.b + push(blocks.backward)
        v = ready.velocity_amplitude
        if rule == "self-consistent":
            v = v - push(seen.line)
        return dataclasses.replace(known, velocity=v).reflection(Means(a, a, b))

    slope = (reflection(step) - reflection(-step)) / (2 * step)
    assert (slope[:3] - moved[block]).abs().max() < 1e-8


def test_rms_drive_moves_with_the_mean_square(noisy, liner):
    """Its deviation is dR/d(v'^2) times that of the block's mean square."""
    ready = prepare([noisy], liner, None, Choices(drive="rms", mean="removed"))[0]
    replayed = replay(ready)
    rule = replayed.rule("averaged")
    found = block_deviations(ready, rule, replayed.means)(slice(0, 6))[3, :, 0]
    begin, end = ready.blocks.borders[3:5]
    v = noisy.velocity
    square, mean = (v**2).mean(1), v.mean(1)
    step = 1e-5
    own = ready.survey.blocks
    change = (own.mean_square[3] - own.mean_square.mean(0))[:6]
    change = change - 2 * mean * (own.mean[3] - own.mean.mean(0))[:6]
    assert own.mean_square[3, :6] == pytest.approx((v[:, begin:end] ** 2).mean(1), rel=1e-12)
    ends = []
    for sign in (-1, 1):
        speed = (square - mean**2 + sign * step * change).sqrt()
        ends.append(tl.reflection_from_impedance(liner.impedance(FREQUENCY, speed)))
    assert ((ends[1] - ends[0]) / (2 * step) - found).abs().max() < 1e-7


@pytest.mark.parametrize(
    ("periods", "of"),
    [
        (100, "probe"),
        (16, "probe"),
        pytest.param(16, "cell of 16", marks=pytest.mark.slow),
        pytest.param(100, "cell of 16", marks=pytest.mark.slow),
    ],
)
def test_coverage(periods, of):
    """Intervals of 95 % hold the truth Z(E[R]) in 93 to 97 % of 1000 trials."""
    script = load_script("coverage")
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        liner = tl.load_liner("onera")
        row = script.coverage("1 kHz noise", periods, 1000, liner, of=of)
    assert 93 <= row["R inside (%)"] <= 97
    assert 93 <= row["X inside (%)"] <= 97


def test_coverage_script_knows_the_truth():
    """The script's truth, against the mean over a long record of its own noise."""
    script = load_script("coverage")
    liner = tl.load_liner("onera")
    for name, shape in script.SPECTRA.items():
        speed = script.velocity(shape, 40, 1 << 16, 5).abs()
        assert float((speed**2).mean().sqrt()) == pytest.approx(script.RMS, rel=0.03), name
        mean = tl.reflection_from_impedance(liner.impedance(script.FREQUENCY, speed)).mean()
        found = complex(tl.impedance_from_reflection(mean))
        assert abs(found - script.true_impedance(liner)) < 0.03


# Files, commands, doubts


def test_map_file_keeps_intervals_and_spread_apart(tmp_path, liner):
    """Written and read: the same bounds; variables say what they are."""
    plane = plane_of(turbulence((3, 4, SAMPLES)), x=[0, 1e-3, 2e-3, 3e-3], z=[0, 1e-3, 2e-3])
    found = tl.educe(plane, liner, [FREQUENCY, 900.0])
    found.write(tmp_path / "map.h5")
    again = tl.read_map(tmp_path / "map.h5")
    for name, interval in vars(found.uncertainty).items():
        if name == "settings":
            assert dict(again.uncertainty.settings) == dict(interval)
            continue
        for bound, values in vars(interval).items():
            assert torch.equal(getattr(getattr(again.uncertainty, name), bound), values)
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(tmp_path / "map.h5", engine="h5netcdf", group="intervals") as file:
        assert file.resistance_low.dims == ("z", "x", "frequency")
        assert file.along_x_reactance_high.dims == ("x", "frequency")
        assert "statistical" in file.liner_resistance_low.attrs["long_name"]
        assert "not the spread" in file.liner_resistance_low.attrs["long_name"]
    with xarray.open_dataset(tmp_path / "map.h5", engine="h5netcdf") as file:
        assert "spread over positions" in file.liner_spread_resistance.attrs["long_name"]
        wanted = found.resistance.reshape(-1, 2).std(0)
        assert np.allclose(file.liner_spread_resistance, wanted)


def test_old_maps_without_intervals_are_read(tmp_path, noisy, liner):
    found = tl.educe(noisy, liner, interval=None)
    assert found.uncertainty is None
    found.write(tmp_path / "map.h5")
    assert tl.read_map(tmp_path / "map.h5").uncertainty is None


def test_excluded_probes_have_no_interval(noisy, liner):
    velocity = noisy.velocity.clone()
    velocity[1, 7] = torch.nan
    plane = dataclasses.replace(noisy, velocity=velocity)
    with pytest.warns(tl.DataWarning, match="excluded"):
        found = tl.educe(plane, liner, missing="exclude")
    assert found.probes["admittance"].interval.low[1].isnan().all()
    assert found.liner["admittance"].interval.low.real.isfinite().all()


@pytest.mark.filterwarnings("ignore:.*states no cell_pitch")
def test_span_and_cells_are_resampled(liner):
    """Independent rows: an interval as wide as that over time, on more runs where rows tell so."""
    liner = liner.replace(cell_pitch=None)  # rows of probes within a cell would not be alike
    gained = []
    for seed in range(4):
        rows, columns = [1e-3 * i for i in range(8)], [0, 1e-3, 2e-3, 3e-3]
        plane = plane_of(turbulence((8, 4, 40 * 30), seed=seed), z=rows, x=columns)
        time = tl.educe(plane, liner).uncertainty
        span = tl.educe(plane, liner, resample="time-span").uncertainty
        gained.append(float(span.liner.runs[0]) / float(time.liner.runs[0]))
        widths = [float((u.liner.high - u.liner.low)[0].real) for u in (time, span)]
        assert widths[1] == pytest.approx(widths[0], rel=0.5)
        assert torch.equal(time.probes.low, span.probes.low)
    assert min(gained) > 0.99
    assert max(gained) > 3


def test_nothing_to_resample_along_z_is_said(noisy, liner):
    with pytest.warns(tl.DataWarning, match="'time-span' finds one row .* over time alone"):
        tl.educe(noisy, liner, resample="time-span")


def test_too_short_for_a_block(liner):
    plane = plane_of(turbulence((2, 3 * 30)))
    with pytest.warns(tl.DataWarning, match="no error bars, since the record holds 3 whole per"):
        found = tl.educe(plane, liner, allow_short=True, edge="wrap", window="boxcar")
    assert found.uncertainty is None
    assert any("no error bars" in note for note in found.notes)


@pytest.mark.parametrize("order", ["admittance", "velocity", "phase-locked"])
def test_less_than_a_period_has_no_blocks(liner, order, tmp_path):
    """The whole record then counts; moments and their file do without blocks, too."""
    v = turbulence((2, 20))
    plane = plane_of(v)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        found = tl.educe(plane, liner, allow_short=True, averaging=order)
        known = tl.moments(plane, liner, allow_short=True, averaging=order)
        known.write(tmp_path / "m.h5")
        again = tl.read_moments(tmp_path / "m.h5").educe(liner, allow_short=True, averaging=order)
    assert found.uncertainty is None
    assert torch.equal(found.answer, again.answer)
    if order == "admittance":
        z = liner.impedance(FREQUENCY, v.abs())
        wanted = ((z - 1) / (z + 1)).mean(1)
        assert float((found.reflection[:, 0] - wanted).abs().max()) < 1e-8


def test_fewer_than_eight_blocks_are_said(liner):
    plane = plane_of(turbulence((2, 10 * 30)))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        assert tl.educe(plane, liner, interval=None).uncertainty is None
    with pytest.warns(tl.DataWarning, match=r"rest on 5 independent blocks, fewer than 8.* about 21 per"):
        tl.educe(plane, liner, edge="wrap")


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"interval": 1.0}, "interval is 1; it is a level between 0 and 1"),
        ({"interval": 95.0}, "interval is 95; it is a level between 0 and 1"),
        ({"resample": "span"}, "unknown resample 'span'.*time-span"),
    ],
)
def test_bad_choices(noisy, liner, choices, message):
    with pytest.raises(ValueError, match=message):
        tl.educe(noisy, liner, **choices)


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"levels": 100.5}, "levels is 100.5; a whole number is needed"),
        ({"levels": None}, "levels is None; a whole number is needed"),
        ({"draws": 999}, "no option is called 'draws'"),
        ({"interval": "0.95"}, "interval is the text '0.95'; a number is needed"),
    ],
)
def test_choices_of_a_wrong_kind(noisy, liner, choices, message):
    with pytest.raises(TypeError, match=message):
        tl.educe(noisy, liner, **choices)


def test_csv_holds_the_bounds(tmp_path, noisy, liner):
    """A row a probe, bounds in columns of their own."""
    found = tl.educe(noisy, liner)
    found.write(tmp_path / "map.csv")
    rows = list(csv.DictReader((tmp_path / "map.csv").read_text().splitlines()))
    bounds = found.probes["admittance"].interval
    ends = zip(bounds.low[:, 0].tolist(), bounds.high[:, 0].tolist(), strict=True)
    for row, (low, high) in zip(rows, ends, strict=True):
        assert float(row["resistance low (rho c)"]) == pytest.approx(low.real, rel=1e-8)
        assert float(row["reactance high (rho c)"]) == pytest.approx(high.imag, rel=1e-8)
        assert float(row["velocity rms (m/s)"]) > 1


def test_command_prints_both(capsys):
    """Spread and interval stand in different columns; --no-intervals leaves them out."""
    path = str(DATA / "slit_n130_y2.5mm.h5")
    assert main(["educe", path, "--quiet"]) == 0
    printed = capsys.readouterr().out
    assert "spread R, X" in printed
    assert "95 % statistical interval" in printed
    assert main(["educe", path, "--quiet", "--json", "--interval", "0.9"]) == 0
    row = json.loads(capsys.readouterr().out)[0]["rows"][0]
    low, high = row["interval"]
    assert low["resistance"] < row["probes_first"]["resistance"] < high["resistance"]
    assert main(["educe", path, "--quiet", "--no-intervals"]) == 0
    assert "interval" not in capsys.readouterr().out


def test_few_runs_are_told_of_where_they_bound_nothing(liner):
    """The record that needs the note most: the difference of infinite bounds is not nan."""
    velocity = turbulence((1, round(4 * RATE / FREQUENCY)), 20, 12.0)
    with pytest.warns(tl.DataWarning, match="rest on 2 independent blocks"):
        found = tl.educe(plane_of(velocity), liner, averaging="admittance")
    assert float(found.liner["admittance"].interval.high.real) == math.inf
    assert found.liner["admittance"].interval.widths.tolist() == [[math.inf], [math.inf]]


# Numbers of docs/uncertainty.md


def page() -> str:
    return (DATA.parent / "docs" / "uncertainty.md").read_text(encoding="utf-8")


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_the_page_has_the_interval_that_misses():
    """Of ``o145`` at 2.5 mm, in the order that ``educe`` answers in."""
    stated = re.search(r"`o145` at 2\.5 mm has R between ([\d.]+) and ([\d.]+)", page())
    plane = tl.read_plane(DATA / "orifice_o145_y2.5mm.h5")
    found = tl.educe(plane, tl.load_liner(plane.liner)).liner["phase-locked"].interval
    ends = [float(found.low.real), float(found.high.real)]
    assert ends == pytest.approx([float(each) for each in stated.groups()], abs=6e-4)


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
def test_the_page_has_the_halves_that_differ():
    stated = re.search(r"halves of `g03_145` differ by ([\d.]+) in R at 0\.5 mm, by ([\d.]+)", page())
    for height, apart in zip(("0.5", "2.5"), stated.groups(), strict=True):
        plane = tl.read_plane(DATA / f"slit_g03_145_y{height}mm.h5")
        middle, liner = plane.samples // 2, tl.load_liner(plane.liner)
        halves = [
            tl.educe(
                dataclasses.replace(plane, velocity=plane.velocity[..., part], streamwise=None),
                liner,
                interval=None,
            ).answer.real
            for part in (slice(None, middle), slice(middle, None))
        ]
        assert float(halves[1] - halves[0]) == pytest.approx(float(apart), abs=6e-3)


@pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
@pytest.mark.parametrize(("periods", "fewest"), [(4, 2), (6, 3), (7, 3.5), (8, 4), (20, 4)])
def test_fewest_independent_runs(liner, periods, fewest):
    """As the page has them, of a flow that drifts all along the record."""
    drift = torch.linspace(1, 4, round(periods * RATE / FREQUENCY), dtype=torch.float64)
    found = tl.educe(plane_of(drift[None]), liner, averaging="admittance")
    assert float(found.liner["admittance"].interval.runs) == fewest
    assert "(of 4 to 7 periods: half as many)" in page()
