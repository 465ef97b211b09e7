"""Point impedances as netCDF-4, as CSV, and as groups of a map file."""

from __future__ import annotations

from collections.abc import Callable

import torch

from torchliner.io.csv_rows import Rows, parts_of, rows_of
from torchliner.io.own_file import RESULT_ENDINGS, OwnFile
from torchliner.records import PointImpedances


def _rows(result: PointImpedances) -> Rows:
    """One row a place and frequency: points, cells, and the liner."""
    nowhere, unknown = torch.full((1,), torch.nan), torch.full((1, 1), torch.nan)
    blocks = (
        ("point", result.point_x, result.point_z, result.point_impedance,
         torch.complex(unknown, unknown), unknown),
        ("cell", result.cell_x, result.cell_z, result.cell_impedance,
         result.cell_impedance_pressure_first, result.coherence),
        ("liner", nowhere, nowhere, result.liner_impedance[None],
         result.liner_impedance_pressure_first[None], result.coherence.mean(0, keepdim=True)),
    )  # fmt: skip
    rows: Rows = []
    for place, x, z, value, first, coherence in blocks:
        columns = {
            "place": place, "x (m)": x[:, None], "z (m)": z[:, None],
            "frequency (Hz)": result.frequency,
            **parts_of(value, "resistance (rho c)", "reactance (rho c)"),
            **parts_of(first, "resistance, pressure first", "reactance, pressure first"),
            "coherence": coherence,
        }  # fmt: skip
        for order in ("", "_pressure_first") if result.uncertainty is not None else ():
            name = {"cell": "cells"}.get(place, "liner") + order
            found = getattr(result.uncertainty, name)
            for end in ("low", "high"):
                words = f"{order.replace('_', ', ', 1).replace('_', ' ')}, statistical {end}"
                # Points have none.
                bound = getattr(found, end) if place != "point" else torch.complex(unknown, unknown)
                columns |= parts_of(bound, f"resistance{words}", f"reactance{words}")
        rows += rows_of(columns, (len(x), len(result.frequency)))
    return rows


def _rows_of(place: str) -> Callable[[PointImpedances], Rows]:
    return lambda result: [row for row in _rows(result) if row["place"] == place]


PLACES = {f"{place}s": _rows_of(place) for place in ("point", "cell", "liner")}
FILE = OwnFile(
    "torchliner points 1", "set of point impedances", record=PointImpedances, others=RESULT_ENDINGS,
    rows={"all": _rows, **PLACES}, csv={"number": ".9g"},
)  # fmt: skip
write_points, read_points = FILE.write, FILE.read
