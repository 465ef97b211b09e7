"""Results for other programs: MATLAB, NASTRAN, and solvers that read columns of text."""

from __future__ import annotations

import textwrap
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from torchliner.io.own_writer import complex_names, in_memory
from torchliner.io.whole_file import printable, written_whole

FEWEST = {".bdf": 2, ".dat": 2}  # frequencies: a table of one cannot be interpolated
AT_PLACES = (".vtp", ".vtkhdf")
LONGEST = 70  # characters of a comment of NASTRAN: a line has 72 to 80


def require_result(path: str | Path, frequencies: float, places: bool = True) -> None:
    """Refuse a name in whose format a result could not be written, also before the work.

    Args:
        path: whose ending names the format.
        frequencies: how many the result has.
        places: whether its probes have x or z.
    Raises:
        ValueError: fewer frequencies than the format needs; no places.
    """
    ending = Path(path).suffix.lower()
    if frequencies < FEWEST.get(ending, 1):
        raise ValueError(
            f"{path}: a {ending} needs {FEWEST[ending]} frequencies at least and the result has {frequencies:g}; educe "
            "with several, or write .txt"
        )
    if ending in AT_PLACES and not places:
        raise ValueError(
            f"{path}: a {ending} needs places and the result has no x or z; state them in the data, or write .csv"
        )


def write_matlab(record: Any, path: str | Path) -> None:
    """One struct ``result`` (MATLAB v5), groups as structs within it, ``choices`` as JSON."""
    from scipy.io import savemat

    with in_memory(record) as (_, whole):
        found = _plain(whole)
    with written_whole(path, ".mat") as temporary:
        savemat(str(temporary), {"result": found}, appendmat=False, long_field_names=True, oned_as="column")


def _plain(group: h5py.Group) -> dict[str, Any]:
    """Variables and texts of a group; a real and an imaginary part become one array."""
    found: dict[str, Any] = {key: text.decode() for key, text in group.attrs.items() if isinstance(text, bytes)}
    for name, each in group.items():
        if isinstance(each, h5py.Group):
            found[name] = _plain(each)
        else:
            texts = h5py.check_string_dtype(each.dtype)
            found[name] = np.array(each.asstr()[()], dtype=object) if texts else each[()]
    for name, (real, imaginary) in complex_names(found).items():
        found[name] = found.pop(real) + 1j * found.pop(imaginary)
    return found


def write_nastran(record: Any, path: str | Path) -> None:
    """Bulk data: TABLED1 1 is R(f), 2 is X(f) of the whole liner, in units of rho c, in large fields.

    Raises:
        ValueError: a single frequency, of which no table can be interpolated; as ``_over_frequency``.
    """
    table = _over_frequency(record, path)
    require_result(path, len(table))
    lines = [f"$ {part}" for line in _about(record) for part in textwrap.wrap(line, LONGEST)]
    for number, part in enumerate(("resistance", "reactance"), 1):
        lines += [f"$ {part} over frequency in Hz", f"{'TABLED1*':8}{number:16d}{'LINEAR':>16}{'LINEAR':>16}", "*"]
        fields = [f"{value:16.9E}" for value in table[:, (0, number)].reshape(-1)] + [f"{'ENDT':>16}"]
        lines += [f"{'*':8}{''.join(fields[begin : begin + 4])}" for begin in range(0, len(fields), 4)]
    with written_whole(path, ".bdf", ".dat") as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="ascii", errors="replace")


def write_solver_table(record: Any, path: str | Path) -> None:
    """f, R, X of the whole liner, a line each, after comments that begin with ``%``, as COMSOL reads them."""
    heading = "\n".join([*_about(record), "frequency (Hz), resistance (rho c), reactance (rho c)"])
    table = _over_frequency(record, path)
    with written_whole(path, ".txt") as temporary:
        np.savetxt(temporary, table, fmt="%.10g", comments="% ", header=heading, encoding="utf-8")


def _over_frequency(record: Any, path: str | Path) -> np.ndarray:
    """f, R and X of a result's ``answer`` in the order of f, (F, 3); a ValueError where Z is not finite somewhere: a
    solver would interpolate over it."""
    value = record.answer.detach().cpu().numpy()
    table = np.stack([record.frequency.numpy(), value.real, value.imag], 1)
    bad = ~np.isfinite(table).all(1)
    if bad.any():
        at = table[bad, 0].tolist()
        raise ValueError(f"{path}: Z of the whole liner is not finite at {at} Hz; educe without these frequencies")
    return table[table[:, 0].argsort()]


def _about(record: Any) -> list[str]:
    """What the numbers are, a line each."""
    title = " ".join(printable(getattr(record, "title", "") or getattr(record, "name", "")).split())
    said = "Z = R + jX of the whole liner, normalised by rho c, exp(+j omega t), v into the liner"
    return [title, said] if title else [said]
