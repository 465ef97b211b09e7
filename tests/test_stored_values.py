"""HDF5 of others: what was never written, is packed, linked or damaged is said or refused."""

import h5py
import numpy as np
import pytest
import torch
from test_plane_file import RATE, make_plane

import torchliner as tl
from torchliner import file_checks
from torchliner.io.planes import read_plane

V = "wall_normal_velocity"


def good():
    return make_plane(x=[0.0, 0.1, 0.2, 0.3], z=[0.0, 0.1, 0.2], height=1e-3)


def edited(tmp_path, edit):
    """A good file that one edit has changed."""
    path = tmp_path / "a.h5"
    good().write(path)
    with h5py.File(path, "r+") as file:
        edit(file)
    return path


def replaced(file, name, values, **storage):
    """A dataset in the place of another, with its units and without dimension scales."""
    units = file[name].attrs["units"]
    del file[name]
    file.create_dataset(name, data=values, **storage).attrs["units"] = units
    return file[name]


def without_values(name, units):
    """A dataset that nothing was ever written to."""

    def edit(file):
        shape = file[name].shape
        del file[name]
        file.create_dataset(name, shape, "f4").attrs["units"] = units

    return edit


def half_written(file):
    values = file[V][()]
    del file[V]
    new = file.create_dataset(V, values.shape, "f4", chunks=(5, 3, 4))
    new[:10] = values[:10]
    new.attrs["units"] = "m/s"


def linked(name, link):
    def edit(file):
        del file[name]
        file[name] = link

    return edit


def set_attribute(name, key, value):
    return lambda file: (file[name] if name else file).attrs.__setitem__(key, value)


def raw_storage(file):
    shape = file[V].shape
    del file[V]
    file.create_dataset(V, shape, "f4", external=[("v.raw", 0, h5py.h5f.UNLIMITED)])
    file[V].attrs["units"] = "m/s"


def virtual(file):
    shape = file[V].shape
    layout = h5py.VirtualLayout(shape, "f4")
    layout[:] = h5py.VirtualSource("part.h5", "v", shape)
    del file[V]
    file.create_virtual_dataset(V, layout).attrs["units"] = "m/s"


PLANES = {
    "chunks never written": (half_written, rf"{V}: 2 of 4 chunks were never written .* read as 0"),
    "values never written": (without_values(V, "m/s"), rf"{V}: 1 of 1 blocks were never written"),
    "empty": (lambda f: replaced(f, V, h5py.Empty("f4")), rf"{V} has shape \(\)"),
    "height never written": (without_values("height", "m"), "height: 1 of 1 blocks were never written"),
    "a link": (linked("height", h5py.SoftLink("/h")), "height is a link to /h, which is not ther"),
    "a link elsewhere": (linked("height", h5py.ExternalLink("no.h5", "/h")), "height is a link to no.h5:/h, which"),
    "raw storage": (raw_storage, rf"{V} keeps its values outside the file; .*h5repack"),
    "a virtual set": (virtual, rf"{V} keeps its values outside the file; .*h5repack"),
    "x of index units": (set_attribute("x", "units", "1"), "x has units '1'; a length is needed"),
    "x not finite": (lambda f: f["x"].write_direct(np.array([0, 1, np.nan, 2.0])), "x has .* all finite"),
    "x absurd": (lambda f: f["x"].write_direct(np.array([0, 1, 2, 1e300])), r"x holds 1e\+300 m, which is"),
    "texts": (lambda f: replaced(f, "height", "1 mm"), "height is object; numbers are needed"),
    "factor of 0": (set_attribute(V, "scale_factor", 0.0), "scale_factor is 0"),
    "factor of text": (set_attribute(V, "scale_factor", "2"), "scale_factor is '2'; numbers"),
    "nested JSON": (set_attribute("", "provenance", "[" * 9999), "'provenance' is .*Invalid JSON"),
    "JSON of another kind": (set_attribute("", "provenance", "[1]"), "'provenance' is .* an object; repair it"),
}


@pytest.mark.parametrize("lazy", [False, True])
@pytest.mark.parametrize("kind", PLANES)
def test_what_is_not_there_is_no_zero(tmp_path, kind, lazy):
    edit, message = PLANES[kind]
    path = edited(tmp_path, edit)
    with pytest.raises(ValueError, match=f"a.h5.*{message}"):
        read_plane(path, lazy)


def test_what_a_file_fills_is_missing(tmp_path):
    """The fill value of the dataset itself, without an attribute, as netCDF has it."""
    fill = np.float32(9.96921e36)

    def edit(file):
        values = file[V][()].astype("f4")
        values[0, 0, 0] = fill
        replaced(file, V, values, fillvalue=fill, chunks=(20, 3, 4))

    path = edited(tmp_path, edit)
    assert torch.isnan(read_plane(path).velocity).nonzero().tolist() == [[0, 0, 0]]


def test_values_of_other_files_are_named(tmp_path):

    def edit(file):
        with h5py.File(tmp_path / "part.h5", "w") as other:
            other.create_dataset("v", data=file[V][()]).attrs["units"] = "m/s"
        del file[V]
        file[V] = h5py.ExternalLink("part.h5", "v")

    path = edited(tmp_path, edit)
    with pytest.warns(tl.DataWarning, match=r"its values stand in .*part.h5"):
        found = read_plane(path)
    assert torch.equal(found.velocity, good().velocity)


@pytest.mark.parametrize("longer", [False, True])
def test_more_than_memory_is_refused_from_the_header(tmp_path, monkeypatch, longer):

    def edit(file):
        if longer:
            replaced(file, "time", np.arange(400) / RATE)
            replaced(file, V, np.zeros((400, *file[V].shape[1:]), "f4"))

    path = edited(tmp_path, edit)
    monkeypatch.setattr(file_checks, "machine_memory", lambda: 1000.0)
    with pytest.raises(ValueError, match=r"a.h5:/.* takes .* GB; this machine has 1e-06 GB"):
        read_plane(path)
