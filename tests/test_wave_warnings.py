"""What an eduction of waves says against itself, and its statistical interval without draws."""

from __future__ import annotations

import dataclasses
import json
import warnings

import pytest
import torch
from test_two_wave_fit import both_ways
from test_wall_pressure import OTHER, WALLS, line_of

import torchliner as tl
from coverage import METHODS, held_by_draws
from torchliner.cli.main import main
from torchliner.pressure.microphone_errors import LEVEL_ERROR
from torchliner.pressure.plane_waves import sort_waves
from torchliner.pressure.two_waves import free_wave_fit
from torchliner.pressure.waves import kumaresan_tufts
from torchliner.records import MicrophoneLine


def codes(found) -> list[str]:
    return [note.code for note in found.notes]


def off(line: MicrophoneLine, size: float, seed: int) -> MicrophoneLine:
    """With errors of one size in Pa, relative to the rms."""
    random = torch.Generator().manual_seed(seed)
    noise = torch.randn(line.pressure.shape, dtype=torch.complex128, generator=random)
    rms = line.pressure.abs().square().mean(0).sqrt()
    return dataclasses.replace(line, pressure=line.pressure + size * rms * noise)


def test_no_mach_number_is_refused_and_0_says_it(tmp_path, capsys):
    """M = 0 is never assumed: Z 1.93+0.02j would become 0.61+0.99j; what was taken is in JSON."""
    path = str(tmp_path / "line.h5")
    dataclasses.replace(line_of(both_ways()[0]), mach=None).write(path)
    assert tl.read_microphones(path).mach is None
    assert main(["kt", path]) == 2
    assert "line.h5 states no Mach number; give mach=" in capsys.readouterr().err
    for given in ("0.3", "0"):
        assert main(["kt", path, "--mach", given, "--json", "--quiet"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["rows"][0]["mach"] == float(given)
        right = abs(told["rows"][2]["impedance"]["resistance"] - 2.33) < 1e-6
        assert right == (given == "0.3")


@pytest.mark.parametrize("method", [*METHODS.values(), sort_waves])
def test_every_method_of_waves_asks_for_it(method):
    line = dataclasses.replace(line_of(both_ways()[0]), mach=None, liner_start=0.05, liner_end=1.0)
    with pytest.raises(ValueError, match="microphones states no Mach number"):
        method(line)


@pytest.mark.parametrize("side", OTHER)
@pytest.mark.parametrize("share", [0.0, 0.3 + 0.2j])
def test_conjugated_phases_are_noticed(side, share):
    """With two free waves, too, which take the reflected wave for the incident one."""
    line = line_of(both_ways(side, share=share)[0].conj(), side)
    with pytest.warns(tl.DataWarning) as told:
        found = free_wave_fit(line)
    assert any("the phases look conjugated" in str(one.message) for one in told)
    assert [str(one.message) for one in told] == [str(note) for note in found.notes]


def test_intervals_from_the_residual_hold_the_truth():
    """Student's 95 % of R and of X over 40 noisy lines, within what these tell."""
    line, held = line_of(both_ways()[0]), []
    for seed in range(40):
        found = kumaresan_tufts(off(line, 0.005, seed))
        low, high = found.interval(0.95)
        held += [(low.real < WALLS.real) & (WALLS.real < high.real), (low.imag < WALLS.imag) & (WALLS.imag < high.imag)]
    assert 0.87 < float(torch.stack(held).double().mean()) < 0.995


@pytest.mark.parametrize("method", METHODS)
def test_linearised_is_the_draws(method):
    """Errors of 0.5 % in Pa: the standard error is the scatter of eductions of drawn lines."""
    line = line_of(both_ways()[0])
    many = torch.stack([off(line, 0.005, seed).pressure for seed in range(200)])
    scatter = METHODS[method](dataclasses.replace(line, pressure=many)).impedance
    found = METHODS[method](off(line, 0.005, 1))
    assert found.freedom == 2 * (12 - {"two-waves": 3}.get(method, 4))
    scaled = found.standard_error * 0.005 / (found.residual * (24 / found.freedom) ** 0.5)
    for part in ("real", "imag"):
        wanted = getattr(scatter, part).std(0)
        assert (getattr(scaled, part) / wanted).tolist() == pytest.approx([1.0] * 3, rel=0.2)


@pytest.mark.parametrize(("method", "size"), [("kt", 1.0), ("kt", 1.5), ("kt", 3.0), ("two-waves", 3.0)])
def test_intervals_hold_whatever_the_errors_assumed(method, size):
    """Errors up to three times those assumed: 360 of R and X, of 60 lines; 2.4 % is two standard deviations. The errors
    that were used are those that there were."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", tl.DataWarning)
        share, found = held_by_draws(method, "upstream", size, 60, 200)
    assert 0.92 < share < 0.985
    level = torch.stack([one.used_errors[0] for one in found]).median(0).values  # one line in 60 has no second wave
    if size == 3.0:
        assert (level / (3 * LEVEL_ERROR)).tolist() == pytest.approx([1.0] * 3, rel=0.15)
        assert sum("model-misfit" in {getattr(note, "code", "") for note in one.notes} for one in found) == 60
    if size == 1.0:
        assert sum(bool(one.notes) for one in found) <= 6
