"""The table of formats of planes: every row is one, and each file is recognised as its own."""

from __future__ import annotations

import inspect
from dataclasses import fields

import numpy as np
import pytest
import test_csv_histories
import test_openfoam_probes
import test_surface_series
import test_vtkhdf
from plane_files import recognised
from test_plane_formats import dataset, written
from test_powerflow import measurement, store

from torchliner.io.plane_format import PlaneFormat, PlaneRequest
from torchliner.names import PLANE_FORMATS, resolve


def csv(path):
    return test_csv_histories.write(path, test_csv_histories.names(), *test_csv_histories.rows())


MAKERS = {
    "powerflow": lambda f: store(f / "a.snc", measurement("snc"), False),
    "openfoam-probes": lambda f: test_openfoam_probes.probes(f / "probes/0/U").parents[1],
    "openfoam-surfaces": lambda f: test_surface_series.foam(f / "surfaces", "vtp"),
    "vtk": lambda f: test_surface_series.series(f),
    "vtkhdf": lambda f: test_vtkhdf.store(f / "a.vtkhdf"),
    "matlab": lambda f: written(dataset(), f, "mat73")[0],
    "npy": lambda f: written(dataset(), f, "npy")[0],
    "zarr": lambda f: written(dataset(), f, "zarr")[0],
    "netcdf3": lambda f: written(dataset(), f, "netcdf3")[0],
    "hdf5": lambda f: written(dataset(), f, "netcdf4")[0],
    "csv": lambda f: csv(f / "v.csv"),
}  # fmt: skip


@pytest.mark.parametrize("name", MAKERS)
def test_each_file_is_its_own(tmp_path, name):
    """The first format of the table that recognises a file is the right one."""
    path = MAKERS[name](tmp_path)
    found = next(row for row, home in PLANE_FORMATS.items() if recognised(resolve(home), path))
    assert found == name


@pytest.mark.parametrize("name", PLANE_FORMATS)
def test_rows(tmp_path, name):
    """A row is a format, takes only what can be asked, and never raises when it is asked."""
    found = resolve(PLANE_FORMATS[name])
    assert isinstance(found, PlaneFormat)
    assert set(found.takes) <= {each.name for each in fields(PlaneRequest)}
    assert len(inspect.signature(found.open).parameters) == 2
    for i, head in enumerate((b"", b"\0" * 9, b"\x89HDF\r\n\x1a\n\0", b"CDF\1\0\0\0", b"\x93NUMPY",
                              b"# vtk DataFile", b"<VTKFile", b"time", b"\xff\xfe")):  # fmt: skip
        path = tmp_path / f"{i}.bin"
        path.write_bytes(head)
        assert found.recognises(path, head) in (True, False)
        assert found.recognises(tmp_path / "absent", b"") is False
    empty = tmp_path / "0"
    empty.mkdir()
    assert found.recognises(empty, b"") is False
    assert found.recognises(tmp_path, b"") is False
    numbers = np.random.default_rng(0).bytes(4096)
    assert found.recognises(empty, numbers[:4096]) in (True, False)


def test_a_year_is_no_time(tmp_path):
    """A series of VTK files in a folder called by a number is that series."""
    folder = tmp_path / "2024"
    folder.mkdir()
    path = test_surface_series.series(folder)
    assert not recognised(resolve(PLANE_FORMATS["openfoam-surfaces"]), path)
    assert recognised(resolve(PLANE_FORMATS["vtk"]), path)
