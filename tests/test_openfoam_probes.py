"""OpenFOAM's probes: restarts joined, rows told apart, and what is wrong with them."""

from __future__ import annotations

import gzip
import pickle
import re

import numpy as np
import pytest
from conftest import SHARED
from hypothesis import given
from plane_files import (
    FUZZED,
    POINTS,
    STEP,
    UP,
    VALUES,
    X,
    Z,
    answer_or_error,
    cuts,
    mutate,
    mutations,
    opened,
    recognised,
    vectors,
)

from torchliner.checks import DataWarning
from torchliner.io.openfoam_probes import FORMAT
from torchliner.io.plane_format import PlaneRequest

SAMPLE = SHARED / "data/openfoam/probes_line_U.gz"


def probes(path, values=VALUES, points=POINTS, first=0, marks=(), digits=8):
    """A file as the solver writes it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    lines = [f"# Probe {i} ({' '.join(f'{n:.6g}' for n in p)}){'  # Not Found' * (i in marks)}"
             for i, p in enumerate(points)]  # fmt: skip
    lines += ["#       Probe  0  1", "#        Time"]
    lines += [f"{(first + i) * STEP:>13.{digits}g}   {'   '.join(vectors(row))}"
              for i, row in enumerate(values)]  # fmt: skip
    path.write_text("\n".join(lines) + "\n")
    return path


def test_probes_become_the_grid_they_form(tmp_path):
    """Values, rate and coordinates, whatever the order of the probes in the file."""
    order = np.random.default_rng(0).permutation(12)
    path = probes(tmp_path / "U", VALUES[:, order], POINTS[order])
    plane = FORMAT.open(path, UP)
    assert np.allclose(plane.load().velocity.numpy(), VALUES[..., 1].T.reshape(3, 4, 9), atol=1e-7)
    assert plane.sampling_rate == pytest.approx(1 / STEP)
    assert np.allclose(plane.x, X)
    assert np.allclose(plane.z, Z)
    assert plane.provenance["normal_coordinate"] == pytest.approx(1e-3)
    turned = FORMAT.open(path, PlaneRequest(normal="-y")).load().velocity
    assert np.array_equal(turned, -plane.load().velocity)
    side = probes(tmp_path / "side" / "U", points=POINTS[:, [1, 0, 2]])
    along = FORMAT.open(side, PlaneRequest(normal="x")).load().velocity.numpy()
    assert np.allclose(along, VALUES[..., 0].T.reshape(3, 4, 9), atol=1e-7)


def test_points_at_several_heights_are_no_plane(tmp_path):
    """One above another they are refused; on a slope they are told of."""
    with pytest.raises(ValueError, match=r"9 of 12 points stand above .* x = 0 to 0\.03 m"):
        FORMAT.open(probes(tmp_path / "U"), PlaneRequest(normal="x"))
    twice = np.concatenate([POINTS[:6], POINTS[:6] + np.array([0, 1e-3, 0])])
    with pytest.raises(ValueError, match=r"6 of 12 points stand above .* y = 0\.001 to 0\.002 m"):
        FORMAT.open(probes(tmp_path / "two" / "U", points=twice), UP)
    slope = POINTS + np.outer(POINTS[:, 0], [0, 0.01, 0])
    with pytest.warns(DataWarning, match=r"stand at y = .* of which a plane has one"):
        FORMAT.open(probes(tmp_path / "slope" / "U", points=slope), UP)


def test_slabs_are_the_whole_and_travel(tmp_path):
    """A slab is the part of the whole that it says, also in another process."""
    plane = FORMAT.open(probes(tmp_path / "U"), UP)
    stored = pickle.loads(pickle.dumps(plane.velocity))
    assert np.array_equal(stored.read(2, 5), plane.load().velocity.reshape(12, 9).T[2:5])


def test_direction_of_a_flat_plane(tmp_path):
    """A plane tells its normal, a line does not."""
    with pytest.warns(DataWarning, match=r"taken as \+y.*'-y' if the liner lies on the other side"):
        FORMAT.open(probes(tmp_path / "U"), PlaneRequest())
    line = probes(tmp_path / "V", VALUES[:, :4], POINTS[:4])
    with pytest.raises(ValueError, match=r"0.03 x 0 x 0 m along x, y, z.*state normal='y'"):
        FORMAT.open(line, PlaneRequest())
    with pytest.raises(ValueError, match="normal is 'up'"):
        FORMAT.open(line, PlaneRequest(normal="up"))


def test_restarts_are_one_record(tmp_path):
    """Folders of times are joined; an instant that both runs have comes once."""
    probes(tmp_path / "0/U", VALUES[:5])
    probes(tmp_path / "3e-05/U", VALUES[3:], first=3)
    joined = opened(FORMAT, tmp_path)
    assert np.array_equal(joined, opened(FORMAT, probes(tmp_path / "whole")))
    changed = VALUES[3:].copy()
    changed[1, 7, 1] += 0.25
    probes(tmp_path / "3e-05/U", changed, first=3)
    with pytest.raises(ValueError, match=r"3e-05/U begins 2 samples before .* at 4e-05 s .*0\.25"):
        opened(FORMAT, tmp_path)
    for overlap, wanted in (("earlier", VALUES), ("later", np.concatenate([VALUES[:3], changed]))):
        with pytest.warns(DataWarning, match=f"begins 2 samples before .*the {overlap} ones count"):
            found = opened(FORMAT, tmp_path, PlaneRequest(normal="y", overlap=overlap))
        assert np.array_equal(found, opened(FORMAT, probes(tmp_path / overlap, wanted)))
    probes(tmp_path / "3e-05/U", VALUES[7:], first=7)
    with pytest.raises(ValueError, match="lacks 2 frames, the first 2 after sample 4"):
        opened(FORMAT, tmp_path)
    probes(tmp_path / "3e-05/U", VALUES[5:, :8], POINTS[:8], first=5)
    with pytest.raises(ValueError, match=r"other probes \(8\)"):
        opened(FORMAT, tmp_path)
    with pytest.raises(ValueError, match="no 'T' in the folders of its times; there are: U"):
        opened(FORMAT, tmp_path, PlaneRequest(variable="T", normal="y"))


def test_times_of_too_few_digits_are_said(tmp_path):
    """As the solver writes them from 1 s on, unless it is told otherwise."""
    path = probes(tmp_path / "U")
    lines = path.read_text().splitlines()
    path.write_text("\n".join(re.sub(r"^\s*\S+e-0\d", "1.00001", line) for line in lines) + "\n")
    with pytest.raises(ValueError, match=r"have the same time, 1.00001 s.*timePrecision"):
        opened(FORMAT, path)


def test_all_of_an_overlap_is_compared(tmp_path):
    """One sample of 120 that differs is found."""
    values = np.tile(VALUES, (20, 1, 1))
    probes(tmp_path / "0/U", values[:150])
    changed = values[30:].copy()
    changed[2] += 0.25
    probes(tmp_path / "3e-04/U", changed, first=30)
    with pytest.raises(ValueError, match=r"begins 120 samples before .* at 0.00032 s .*0\.25"):
        opened(FORMAT, tmp_path)


def test_probes_outside_the_mesh_are_left_out(tmp_path):
    values = VALUES.copy()
    values[:, 3] = -1e300
    path = probes(tmp_path / "U", values, marks=[3])
    with pytest.warns(DataWarning, match="probes 3 lie outside the mesh.*11 remain"):
        plane = FORMAT.open(path, UP)
    assert np.allclose(plane.load().velocity.numpy().T, np.delete(VALUES[..., 1], 3, 1), atol=1e-6)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda t: t.replace("(0.02 0.001 0)", "(0.02 0.001)"), "numbers no probes"),
        (lambda t: t.rpartition(")   (")[0] + ")\n", "changed from 37 to 34 at row 9; 37 numbers a row"),
        (lambda t: t.replace("1.2312", "1.23x2").replace("-1.2", "-1.2x"), "could not convert"),
        (lambda t: t.split("\n        ")[0] + "\n", "no row of numbers"),
        (lambda t: t.replace("\n        4e-05", "\n        end"), "could not convert string 'end'"),
    ],
)  # fmt: skip
def test_faults(tmp_path, change, message):
    """Each names the file and says where."""
    path = probes(tmp_path / "U")
    text = path.read_text()
    path.write_text(change(text))
    with pytest.raises(ValueError, match=rf"{path}.*({message})"):
        opened(FORMAT, path)


def test_a_row_that_is_not_whole_is_left_out(tmp_path):
    path = probes(tmp_path / "U")
    path.write_text(path.read_text()[:-30])
    with pytest.warns(DataWarning, match="the last line, 23, has no end.*8 rows remain"):
        assert opened(FORMAT, path).shape[-1] == 8


def test_stamps_of_few_digits(tmp_path):
    """Six digits of a late time tell steps of 1e-5 s still; a missing row is told all the same."""
    late = probes(tmp_path / "U", first=3_500_000, digits=7)  # 35.00001 s
    assert FORMAT.open(late, UP).sampling_rate == pytest.approx(1 / STEP)
    rough = np.arange(40) * 4e-5 + 35
    text = late.read_text().split("\n")
    head, row = text[:14], text[14].split(None, 1)[1]
    late.write_text("\n".join([*head, *(f"{t:.7g} {row}" for t in rough), ""]))
    assert FORMAT.open(late, UP).sampling_rate == pytest.approx(2.5e4, rel=0.02)
    late.write_text("\n".join([*head, *(f"{t:.7g} {row}" for t in np.delete(rough, 20)), ""]))
    with pytest.raises(ValueError, match=r"not uniform|lacks"):
        FORMAT.open(late, UP)


@FUZZED
@given(marks=mutations, cut=cuts)
def test_mutated_bytes(tmp_path, marks, cut):
    """An error that names the file, or a plane."""
    path = probes(tmp_path / "U")
    clean = opened(FORMAT, path)
    mutate(path, marks, cut)
    if recognised(FORMAT, path):
        same = answer_or_error(FORMAT, path, UP, "U", clean)
        assert same or marks or cut < 1


@pytest.mark.skipif(not SAMPLE.exists(), reason="samples of a run are not here")
def test_real_probes(tmp_path):
    """1351 rows of 80 probes of a channel."""
    (tmp_path / "U").write_bytes(gzip.decompress(SAMPLE.read_bytes()))
    plane = FORMAT.open(tmp_path / "U", UP)
    assert (plane.probes, plane.samples, plane.sampling_rate) == (80, 1351, pytest.approx(5))
    assert float(plane.load().velocity[1, 0]) == pytest.approx(-0.00206011)
