"""VTK's legacy files, ASCII or binary, of surfaces and flat grids."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from pathlib import Path

import numpy as np

from torchliner.io.surface_frames import Frame, FrameArray, Surface, grid_surface, unpack_faces
from torchliner.io.text_rows import parse_vectors
from torchliner.io.vtk_xml import image_points

TYPES = {"char": "i1", "unsigned_char": "u1", "short": "i2", "unsigned_short": "u2", "int": "i4",
         "unsigned_int": "u4", "vtktypeint64": "i8", "long": "i8", "vtkidtype": "i8",
         "float": "f4", "double": "f8"}  # fmt: skip
Numbers = Callable[[int | None], np.ndarray]  # of an axis, or None for all
TEXTS = ("METADATA", "LOOKUP_TABLE", "CELL_TYPES")


class LegacyFile:
    """What stands in a file in the order in which it stands there; numbers are read when used."""

    def __init__(self, raw: bytes, path: Path) -> None:
        self.raw, self.path, self.place = raw, path, 0
        lines = [self.line() for _ in range(3)]
        if lines[2].upper() not in ("ASCII", "BINARY"):
            raise ValueError(f"{path}: its third line is {lines[2][:20]!r}; ASCII or BINARY is "
                             "needed")  # fmt: skip
        self.binary = lines[2].upper() == "BINARY"
        self.arrays: dict[str, FrameArray] = {}
        self.points: Numbers | None = None
        self.faces: dict[str, Callable[[], tuple[np.ndarray, np.ndarray]]] = {}
        self.kinds: Numbers | None = None
        self.grid: dict[str, list[str]] = {}
        self.time: float | None = None
        self.on_faces, self.count = False, 0

    def line(self) -> str:
        """The next line, without its end."""
        end = self.raw.find(b"\n", self.place)
        end = len(self.raw) if end < 0 else end
        found = self.raw[self.place : end]
        self.place = end + 1
        return found[:256].decode("latin-1").strip()

    def numbers(self, count: int, width: int, kind: str) -> Numbers:
        """A function of an axis (None: all) to ``count`` x ``width`` numbers that stand next."""
        dtype = TYPES.get(kind.lower())
        label = f"{self.path}, at byte {self.place}"
        if dtype is None:
            raise ValueError(f"{label}: numbers of type {kind[:20]!r} are not read")
        if min(count, width) < 0 or count * width > len(self.raw):
            raise ValueError(f"{self.path} is truncated: {count} x {width} numbers are stated at "
                             f"byte {self.place} of {len(self.raw)}")  # fmt: skip
        if self.binary:
            size = count * width * np.dtype(dtype).itemsize
            part = self.raw[self.place : self.place + size]
            self.place += size
            self.place += self.raw[self.place : self.place + 1] == b"\n"
            return partial(_binary, part, count, width, ">" + dtype, label)
        begin = self.place
        self.place = end = _after_numbers(self.raw, begin, count * width)
        return partial(_text, self.raw, begin, end, count, width, label)

    def walk(self) -> None:
        """Read all keywords."""
        while self.place < len(self.raw):
            words = self.line().split()
            if not words or words[0].upper() in TEXTS:
                self._pass_over(words)
                continue
            word, rest = words[0].upper(), words[1:]
            if word == "DATASET":
                self.grid["DATASET"] = rest
            elif word in ("DIMENSIONS", "ORIGIN", "SPACING", "ASPECT_RATIO"):
                self.grid[word] = rest
            elif word == "POINTS":
                self.points = self.numbers(int(rest[0]), 3, rest[1])
            elif word in ("POLYGONS", "CELLS", "VERTICES", "LINES", "TRIANGLE_STRIPS"):
                self._cells(word, int(rest[0]), int(rest[1]))
            elif word in ("POINT_DATA", "CELL_DATA"):
                self.on_faces, self.count = word == "CELL_DATA", int(rest[0])
            elif word in ("VECTORS", "NORMALS"):
                self._array(rest[0], self.count, 3, rest[1])
            elif word == "SCALARS":
                width = int(rest[2]) if len(rest) > 2 else 1
                if self.raw[self.place : self.place + 12].upper() == b"LOOKUP_TABLE":
                    self.line()
                self._array(rest[0], self.count, width, rest[1])
            elif word == "FIELD":
                self._field(int(rest[1]))
            else:
                raise ValueError(f"{self.path}: keyword {words[0][:20]!r} at byte {self.place} is "
                                 "unknown, or what stands before it is damaged")  # fmt: skip

    def _cells(self, word: str, count: int, size: int) -> None:
        """Faces: each its number of corners and these; since version 5.1 offsets, then corners."""
        if self.raw[self.place : self.place + 7] != b"OFFSETS":
            read = self.numbers(size, 1, "int")
            label = f"{self.path}: {word}"
            self.faces[word] = lambda: unpack_faces(_whole(read), count, label)
            return
        ends, corners = (self.numbers(n, 1, self.line().split()[-1]) for n in (count, size))
        self.faces[word] = lambda: (_whole(corners), _whole(ends)[1:])

    def _pass_over(self, words: list[str]) -> None:
        """What says nothing of places and velocity."""
        if words and words[0].upper() == "CELL_TYPES":
            self.kinds = self.numbers(int(words[1]), 1, "int")
        elif words and words[0].upper() == "LOOKUP_TABLE" and len(words) > 2:
            self.numbers(int(words[2]), 4, "unsigned_char" if self.binary else "float")
        elif words and words[0].upper() == "METADATA":
            while self.line():
                pass

    def _field(self, count: int) -> None:
        """Arrays of a FIELD; those of the file as a whole may say the time."""
        for _ in range(count):
            words = self.line().split()
            while not words and self.place < len(self.raw):
                words = self.line().split()
            if words and words[0].upper() == "METADATA":
                self._pass_over(words)
                words = self.line().split()
            name, width, rows, kind = words
            if self.count:
                self._array(name, int(rows), int(width), kind)
                continue
            read = self.numbers(int(rows), int(width), kind)
            if name.lower() in ("time", "timevalue"):
                self.time = float(read(0)[0])

    def _array(self, name: str, count: int, width: int, kind: str) -> None:
        self.arrays[name] = FrameArray(
            self.on_faces, count, width, self.numbers(count, width, kind), kind.lower() == "double"
        )

    def surface(self) -> Surface:
        """Points and faces."""
        if self.points is None:
            return self._image()
        points = self.points(None).astype(np.float64)
        faces = self.faces.get("POLYGONS", self.faces.get("CELLS"))
        if self.grid.get("DATASET") == ["STRUCTURED_GRID"]:
            return grid_surface(points, np.array([int(n) for n in self.grid.get("DIMENSIONS", ())]))
        if faces is None:
            return Surface(points)
        return Surface(points, *faces(), None if self.kinds is None else _whole(self.kinds))

    def _image(self) -> Surface:
        """Points of a uniform grid."""
        if self.grid.get("DATASET") != ["STRUCTURED_POINTS"]:
            raise ValueError(f"{self.path} is of DATASET {self.grid.get('DATASET')}, without "
                             "POINTS; POLYDATA, UNSTRUCTURED_GRID, STRUCTURED_GRID and "
                             "STRUCTURED_POINTS are read")  # fmt: skip
        steps = "SPACING" if "SPACING" in self.grid else "ASPECT_RATIO"
        size, start, step = (np.array([float(n) for n in self.grid.get(name, ())])
                             for name in ("DIMENSIONS", "ORIGIN", steps))  # fmt: skip
        if {len(size), len(start), len(step)} != {3} or np.prod(size) > len(self.raw):
            raise ValueError(f"{self.path}: DIMENSIONS, ORIGIN and SPACING of three axes are "
                             "needed")  # fmt: skip
        size = size.astype(int)
        points = image_points(np.zeros(3, int), size - 1, start, step, np.eye(3))
        return grid_surface(points, size)


def _whole(read: Numbers) -> np.ndarray:
    """Whole numbers, (N,)."""
    return read(None)[:, 0].astype(np.int64)


def _binary(part: bytes, count: int, width: int, kind: str, label: str, axis: int | None) -> np.ndarray:
    if len(part) != count * width * np.dtype(kind).itemsize:
        raise ValueError(f"{label}: truncated, {len(part)} bytes of {count} x {width} numbers")
    whole = np.frombuffer(part, kind).reshape(count, width)
    return whole if axis is None else whole[:, axis]


def _text(raw: bytes, begin: int, end: int, count: int, width: int, label: str, axis: int | None) -> np.ndarray:
    return parse_vectors(raw[begin:end], count, width, axis, label)


def _after_numbers(raw: bytes, begin: int, count: int) -> int:
    """Where a block of so many numbers ends: at the end of a line."""
    place, found = begin, 0
    while found < count and place < len(raw):
        block = raw[place : min(len(raw), place + max(1 << 12, 16 * (count - found)))]
        solid = np.concatenate([[False], np.frombuffer(block, np.uint8) > 32])
        if place > begin and raw[place - 1] > 32:
            solid[0] = True
        starts = np.flatnonzero(solid[1:] > solid[:-1])
        if found + len(starts) >= count:
            end = raw.find(b"\n", place + int(starts[count - found - 1]))
            return len(raw) if end < 0 else end + 1
        found, place = found + len(starts), place + len(block)
    return len(raw)


def parse_legacy(raw: bytes, path: Path) -> Frame:
    """A frame of a legacy file.

    Raises:
        ValueError: it is truncated or damaged, or of another kind of data.
    """
    file = LegacyFile(raw, path)
    file.walk()
    return Frame(file.surface, file.arrays, file.time)
