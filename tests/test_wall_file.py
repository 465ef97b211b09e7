"""Eductions from microphones: files that keep them whole, and damaged ones that are refused."""

from __future__ import annotations

import dataclasses
import hashlib
import math

import pytest
import torch
from test_two_wave_fit import both_ways
from test_wall_pressure import line_of

import torchliner as tl
from torchliner.cli.main import DONE, main
from torchliner.records.wall_eduction import fine_places

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")
SIDES = ("upstream", "downstream")


def noisy(side, seed=0, **about):
    """A line of two waves and 1 % of noise, so that methods leave a residual."""
    pressure = both_ways(side)[0]
    draw = torch.Generator().manual_seed(seed)
    noise = torch.randn(pressure.shape, dtype=torch.complex128, generator=draw)
    return line_of(pressure * (1 + 0.01 * noise), side, title=f"{side} case", **about)


def field_fit(line, draws=True):
    """A fit of the field as ``fit_field`` returns it, with numbers at random."""
    draw = torch.Generator().manual_seed(1)
    lead = (3,) if draws is None else ()

    def random(*shape):
        return torch.randn(*lead, *shape, dtype=torch.complex128, generator=draw)

    count, along = len(line.frequency), fine_places(line.x)
    spread = random(count, 2, 2).abs()
    return tl.FieldFit(
        method="LEE fit",
        frequency=line.frequency,
        x=line.x,
        impedance=2 + random(count) / 9,
        covariance=spread @ spread.mT * 1e-4,
        amplitude=random(count),
        end_reflection=random(count),
        pressure=random(line.microphones, count),
        along=along,
        pressure_along=random(len(along), count),
        residual=random(count).abs(),
        misfit=random(count).abs(),
        converged=random(count).real > 0,
        source_side=line.source_side,
        draws=field_fit(line, None) if draws else None,
        line=line,
        choices={"method": "field", "mach": 0.3},
    )


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """Both sources of one wall, what kt makes of them with draws, and its page."""
    folder = tmp_path_factory.mktemp("wall")
    for side in SIDES:
        noisy(side).write(folder / f"{side}.h5")
    words = ["kt", *(str(folder / f"{side}.h5") for side in SIDES)]
    found = str(folder / "found.h5")
    assert main([*words, "--draws", "20", "--seed", "7", "-o", found, "--quiet"]) == DONE
    return folder


def test_a_file_keeps_an_eduction_whole(tmp_path):
    """KT with draws and a lost frequency, fits tied and free, the field: all of it, in order."""
    line = noisy("upstream", provenance={"who": "me"}, reference={"true": 1 + 0j})
    lost = tl.kumaresan_tufts(line, draws=3)
    wave = lost.wavenumber.clone()
    wave[1] = complex(math.nan, math.nan)
    found = [
        dataclasses.replace(lost, wavenumber=wave),
        tl.two_wave_fit(line, condition="continuous-velocity"),
        tl.two_wave_fit(line, tied=False),
        field_fit(dataclasses.replace(line, title="")),
    ]
    found[0].write(tmp_path / "found.nc", *found[1:])
    again = tl.read_wall(tmp_path / "found.nc")
    assert len(again) == 4
    for one, other in zip(found, again, strict=True):
        assert dict(other.choices) == dict(one.choices)
        assert torch.equal(one.impedance, other.impedance)
        assert torch.equal(one.interval()[1], other.interval()[1])
        assert other.source_line.name == one.choices.get("source", "microphones")
        assert torch.equal(one.level_along()[1], other.level_along()[1])


def test_choices_command_and_hashes_are_kept(files):
    """Of each line its own file; the seed; the command that was typed."""
    for one, side in zip(tl.read_wall(files / "found.h5"), SIDES, strict=True):
        path = files / f"{side}.h5"
        (known,) = one.choices["inputs"]
        assert (known["what"], known["name"]) == ("microphones", str(path))
        assert known["hash"] == hashlib.sha256(path.read_bytes()).hexdigest()
        assert (one.choices["seed"], one.choices["draws"], one.choices["margin"]) == (7, 20, 0.0)
        assert one.choices["version"] == tl.__version__
        assert one.choices["command"][:2] == ["kt", str(path.parent / "upstream.h5")]


def test_what_is_no_line_of_one_case_has_no_file(files, tmp_path):
    with pytest.raises(ValueError, match="'torchliner wall 1' is needed"):
        tl.read_wall(files / "upstream.h5")
    with pytest.raises(ValueError, match=r"holds \(2,\) lines; a file or a page"):
        tl.two_wave_fit(line_of(torch.stack([both_ways()[0]] * 2))).write(tmp_path / "two.h5")
    assert not (tmp_path / "two.h5").exists()
