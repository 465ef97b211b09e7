"""Results for MATLAB: the variables of the netCDF-4 file, complex ones in one piece."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import savemat

from torchliner.io.own_file import OwnFile, complex_names
from torchliner.io.result_writers import ResultWriter
from torchliner.io.whole_file import written_whole


def write_matlab(file: OwnFile, record: Any, path: str | Path) -> None:
    """One struct ``result`` (MATLAB v5), groups as structs within it, ``choices`` as JSON."""
    with file.in_memory(record) as (_, whole):
        found = _plain(whole)
    with written_whole(path, ".mat") as temporary:
        savemat(
            str(temporary),
            {"result": found},
            appendmat=False,
            long_field_names=True,
            oned_as="column",
        )


def _plain(group: h5py.Group) -> dict[str, Any]:
    """Variables and texts of a group; a real and an imaginary part become one array."""
    found: dict[str, Any] = {key: text.decode() for key, text in group.attrs.items() if isinstance(text, bytes)}
    for name, each in group.items():
        if isinstance(each, h5py.Group):
            found[name] = _plain(each)
        elif h5py.check_string_dtype(each.dtype):
            found[name] = np.array(each.asstr()[()], dtype=object)
        else:
            found[name] = each[()]
    for name, (real, imaginary) in complex_names(found).items():
        found[name] = found.pop(real) + 1j * found.pop(imaginary)
    return found


WRITER = ResultWriter(write_matlab)
