"""The record of moments as netCDF-4: all that an eduction takes, to the last bit."""

from __future__ import annotations

from pathlib import Path

import h5py

from torchliner.io.hdf5 import open_file, text_attribute

STEM = "torchliner moments "


def holds_moments(path: str | Path) -> bool:
    """Whether a file says that it holds moments, of whatever format."""
    if not (Path(path).is_file() and h5py.is_hdf5(path)):
        return False
    with open_file(path) as file:
        return (text_attribute(file, "schema") or "").startswith(STEM)
