"""Files of moments: an eduction from one is that from memory to the bit; what is wrong is told."""

from __future__ import annotations

import json

import h5py
import numpy as np
import pytest
import torch
from conftest import FREQUENCY, plane_of
from test_moments import CHOICES, parts_of, same_bits, velocity

import torchliner as tl

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def grid_plane(dtype=torch.float32, **about):
    """(z, x) probes with all that a plane may state."""
    facts = {
        "x": 0.01 * torch.arange(4.0), "z": 0.02 * torch.arange(2.0), "height": 1e-3,
        "incident_level": 130.0, "mach": 0.1, "source_side": "upstream", "liner": "polito",
        "reference": {"true": 1 - 0.5j}, "title": "two rows", "provenance": {"run": 7},
        "start": 0.25,
    }  # fmt: skip
    return plane_of(velocity(900, 8, dtype).reshape(2, 4, -1), **facts | about)


@pytest.mark.parametrize("choices", CHOICES, ids=str)
@pytest.mark.parametrize("dtype", [torch.float32, torch.float64])
def test_a_file_answers_as_memory_does(choices, dtype, liner, tmp_path):
    """Sums, map, intervals and closure to the bit, and all that is known of the plane."""
    path = tmp_path / "m.h5"
    known = tl.moments(grid_plane(dtype), cell_pitch=liner.cell_pitch, **choices)
    known.write(path)
    found = tl.read_moments(path)
    assert same_bits(found.sums, known.sums)
    assert same_bits(found.educe(liner, **choices), known.educe(liner, **choices))
    assert (found.settings, found.cell_pitch, found.notes) == (
        known.settings, known.cell_pitch, known.notes)  # fmt: skip
    facts = "start height frequency incident_level mach source_side liner reference title provenance"
    for name in [*facts.split(), "sampling_rate", "fluid", "probe_shape"]:
        assert getattr(found.plane, name) == getattr(known.plane, name)
    assert torch.equal(found.plane.x, known.plane.x)
    with pytest.raises(ValueError, match=r"m\.h5 holds moments.* 900 time samples are gone"):
        found.plane.read(0, 1)


def test_other_shapes_of_planes(tmp_path):
    """A table's levels, no coordinates, probes left out, the sum of a first reading alone."""
    v = velocity()
    v[3, ::7] = torch.nan
    table = tl.TabulatedLiner([1000.0, 2000.0], np.full((2, 3), 2 + 1j), [0.0, 5.0, 40.0])
    cases = {
        "levels": tl.moments(plane_of(v.nan_to_num()), table),
        "left out": tl.moments(plane_of(v), missing="exclude"),
        "first": tl.Moments.sum(parts_of(velocity(), (512,))),
    }
    for name, known in cases.items():
        known.write(tmp_path / "m.h5")
        assert same_bits(tl.read_moments(tmp_path / "m.h5").sums, known.sums), name


@pytest.fixture(scope="module")
def clean(tmp_path_factory):
    """Bytes of a file of moments."""
    path = tmp_path_factory.mktemp("moments") / "m.h5"
    tl.moments(grid_plane()).write(path)
    return path.read_bytes()


def _head(key, **changes):
    """A change of a JSON attribute."""

    def change(file):
        file.attrs[key] = json.dumps(json.loads(file.attrs[key]) | changes)

    return change


def _value(name, place, value):
    def change(file):
        file[name][place] = value

    return change


def _cut(name):
    def change(file):
        values, about = file[name][()], dict(file[name].attrs)
        del file[name]
        file.create_dataset(name, data=values[..., :-1]).attrs["units"] = about["units"]

    return change


def _gone(name):
    return lambda file: file.pop(name)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda file: file.attrs.update(schema="torchliner moments 2"),
         "format 'torchliner moments 2', and this torchliner reads 'torchliner moments 1'"),
        (lambda file: file.attrs.update(schema="torchliner map 1"), "is no record of moments"),
        (_head("plan", end=5000), "attribute 'plan'.*are those of no record"),
        (_head("plan", borders=[0, 30, 20]), "attribute 'plan'.*are those of no record"),
        (_head("plan", sampling_rate="fast"), "attribute 'plan'.*fast"),
        (_head("velocity", precision="int8"), "attribute 'velocity'"),
        (_head("basis", kind="levels"), "attribute 'basis': has no 'kinks'"),
        (_head("basis", count=20), r"probe_moments has shape .*order is \(20,\)"),
        (_head("settings", colour="red"), "attribute 'settings': it holds .*colour"),
        (_gone("mean_square"), "/mean_square is missing"),
        (_gone("coherent_moments"), "sum of a first reading alone"),
        (_cut("largest"), r"largest has shape \(16,\)"),
        (_cut("probe_moments"), r"probe_moments has shape .*point is \(8,\)"),
        (_value("smallest", 3, np.nan), "smallest holds 1 values that are not finite"),
        (_value("probe_moments", (0, 5, 2), np.inf), "probe_moments holds 1 .*not finite"),
        (_value("probe_moments", (0, 0, 2), 12.0), "1 of 8 columns, the first 2 with 12"),
        (_value("cell_block_moments", (0, 0, 3, 0), 1e3), "cell_moments and its blocks"),
        (_value("cell_of_probe", 3, 7), "cell_of_probe names others than the 1 cells"),
        (lambda file: file["fit"].attrs.pop("units"), "fit has no units"),
        (_value("used", 3, 2), "used holds other values than 0 and 1"),
    ],
)  # fmt: skip
def test_what_is_no_record_of_moments_is_refused(change, message, clean, liner, tmp_path):
    """File, dataset, value and remedy."""
    path = tmp_path / "m.h5"
    path.write_bytes(clean)
    with h5py.File(path, "r+") as file:
        change(file)
    with pytest.raises(ValueError, match=message) as caught:
        tl.read_moments(path).educe(liner.replace(cell_pitch=None))
    assert str(path) in str(caught.value)


def test_truncated_and_other_files_are_refused(clean, tmp_path):
    """Cut off, no HDF5, a plane; and a window without a name cannot be written."""
    path = tmp_path / "m.h5"
    path.write_bytes(clean[: len(clean) // 2])
    with pytest.raises(OSError, match=r"is truncated: .*; copy it again, or write it anew"):
        tl.read_moments(path)
    path.write_text("moments")
    with pytest.raises(OSError, match="is not an HDF5"):
        tl.read_moments(path)
    grid_plane().write(path)
    with pytest.raises(ValueError, match=r"is no record of moments: its schema is .*plane 1"):
        tl.read_moments(path)
    path.write_bytes(clean)
    with pytest.raises(ValueError, match=r"no velocity plane but .*moments 1"):
        tl.read_plane(path)
    with pytest.raises(ValueError, match="must be one of"):
        tl.moments(grid_plane()).write(tmp_path / "m.csv")


@pytest.mark.parametrize(
    ("choices", "message"),
    [
        ({"drive": "rms"}, r"reduced with drive 'instantaneous', and 'rms' is asked for"),
        ({"engine": "unfold"}, "engine 'unfold' cannot replay"),
        ({"phase": "self-consistent"}, "no sums of waves of 2800 Hz"),
        ({"window": "hann"}, "reduced with window 'whole-periods'"),
    ],
)
def test_what_moments_do_not_hold_is_told(choices, message, liner):
    """Another drive, an engine of samples, rows that were not kept, another cell."""
    known = tl.moments(grid_plane())
    bare = liner.replace(cell_pitch=None)
    with pytest.raises(ValueError, match=message):
        known.educe(bare, **choices)
    with pytest.raises(ValueError, match=r"cells of all probes .*12\.44 mm"):
        known.educe(liner)
    other = known.educe(bare, order="velocity first")
    wanted = tl.educe(grid_plane(), bare, FREQUENCY, order="velocity first")
    assert torch.allclose(other.answer, wanted.answer, rtol=1e-6)
