"""Point impedances as netCDF-4, as CSV, and as groups of a map file."""

from __future__ import annotations

from torchliner.io.csv_rows import Rows
from torchliner.io.own_file import RESULT_ENDINGS, OwnFile
from torchliner.records import PointImpedances


class PointFile(OwnFile):
    """Points, cells and the whole surface stand in one CSV."""

    def rows(self, record: PointImpedances, of: str | None = None) -> Rows:
        """Of all places, if none is named."""
        places = self.places if of is None else [of]
        rows = {place: super(PointFile, self).rows(record, place) for place in places}
        return [{"place": place.removesuffix("s"), **row} for place, own in rows.items() for row in own]


FILE = PointFile(
    "torchliner points 1",
    "set of point impedances",
    record=PointImpedances,
    others=RESULT_ENDINGS,
    places={"points": ("point",), "cells": ("cell",), "liners": ()},
    csv={"number": ".9g"},
)
write_points, read_points = FILE.write, FILE.read
