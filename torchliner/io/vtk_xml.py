"""VTK's XML files: ASCII, base64 inline, appended raw or base64, with zlib or without."""

from __future__ import annotations

import base64
import math
import re
import zlib
from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from torchliner.file_checks import require_memory
from torchliner.io.surface_frames import Frame, FrameArray, Surface, grid_surface
from torchliner.io.text_rows import parse_vectors

KINDS = ("PolyData", "UnstructuredGrid", "StructuredGrid", "ImageData")
TAG = re.compile(rb"<(/?)(\w+)([^<>]*)>")
ATTRIBUTE = re.compile(rb"([\w:]+)\s*=\s*(?:\"([^\"]*)\"|'([^']*)')")
TYPES = {f"{name}{8 * size}": f"{kind}{size}" for name, kind in
         (("Float", "f"), ("Int", "i"), ("UInt", "u")) for size in (1, 2, 4, 8)}  # fmt: skip


@dataclass
class Part:
    """A DataArray: the sections it stands in, its attributes, and what stands inside it."""

    section: tuple[str, ...]
    about: dict[str, str]
    text: bytes


class XmlFile:
    """Tags and arrays of a file; nothing is decoded before it is asked for."""

    def __init__(self, raw: bytes, path: Path) -> None:
        self.path = path
        cut = raw.find(b"<AppendedData")
        self.appended = b""
        if cut >= 0:
            start = raw.find(b"_", raw.find(b">", cut))
            self.appended = raw[start + 1 :]
            self.coded = b"base64" in raw[cut:start]
        self.root: dict[str, str] = {}
        self.pieces: list[dict[str, str]] = []
        self.parts: list[Part] = []
        self.kind = ""
        self.about_kind: dict[str, str] = {}
        self._scan(raw if cut < 0 else raw[:cut])
        if self.kind not in KINDS or not self.pieces:
            raise ValueError(f"{path} is VTK data of type {self.root.get('type')!r}; "
                             f"{', '.join(KINDS)}, in one file, are read")  # fmt: skip
        if self.root.get("compressor", "vtkZLibDataCompressor") != "vtkZLibDataCompressor":
            raise ValueError(f"{path} is compressed by {self.root['compressor']}; zlib is read: "
                             "write it without compression")  # fmt: skip
        self.order = "<" if self.root.get("byte_order", "LittleEndian") == "LittleEndian" else ">"
        wide = self.root.get("header_type") == "UInt64"
        self.word = np.dtype(f"{self.order}u{8 if wide else 4}")

    def _scan(self, head: bytes) -> None:
        """Walk over the tags."""
        section: list[str] = []
        place = 0
        while (tag := TAG.search(head, place)) is not None:
            place, name = tag.end(), tag[2].decode()
            about = {key.decode(): (one or two).decode("utf-8", "replace")
                     for key, one, two in ATTRIBUTE.findall(tag[3])}  # fmt: skip
            if tag[1]:
                if name in section:
                    del section[len(section) - 1 - section[::-1].index(name) :]
                continue
            if name == "DataArray":
                end = place if tag[3].endswith(b"/") else head.find(b"</DataArray", place)
                if end < 0:
                    raise ValueError(f"{self.path} is truncated in the array {about.get('Name')!r}")
                # Of its text: keys of information may follow inside.
                text = head[place:end].partition(b"<")[0]
                self.parts.append(Part(tuple(section), about, text))
                place = end
                continue
            if name == "VTKFile":
                self.root = about
            elif name == "Piece":
                self.pieces.append(about)
            elif section[-1:] == ["VTKFile"]:
                self.kind, self.about_kind = name, about
            if not tag[3].endswith(b"/"):
                section.append(name)

    def of(self, section: str, name: str | None = None) -> list[Part]:
        """Arrays of a section, one of each piece."""
        return [p for p in self.parts
                if section in p.section and name in (None, p.about.get("Name"))]  # fmt: skip

    def values(self, part: Part, count: int, width: int = 1, axis: int | None = None) -> np.ndarray:
        """``count`` values of ``width`` components, (N, width), or one component, (N,)."""
        kind = TYPES.get(part.about.get("type", ""))
        label = f"{self.path}, array {part.about.get('Name')!r}"
        if kind is None:
            raise ValueError(f"{label} is of type {part.about.get('type')!r}; numbers are needed")
        form = part.about.get("format", "ascii")
        if form == "ascii":
            found = parse_vectors(part.text, count, width, axis, label)
        else:
            raw = self._binary(part, form, label)
            dtype = np.dtype(self.order + kind)
            if len(raw) != count * width * dtype.itemsize:
                raise ValueError(f"{label} has {len(raw)} bytes; {count} x {width} of {kind} take "
                                 f"{count * width * dtype.itemsize}")  # fmt: skip
            whole = np.frombuffer(raw, dtype).reshape(count, width)
            found = whole if axis is None else whole[:, axis]
        return found[:, 0] if width == 1 and axis is None else found

    def _binary(self, part: Part, form: str, label: str) -> bytes:
        """Bytes of an array that is stored inline or appended."""
        if form == "binary":
            source, coded = b"".join(part.text.split()), True
        elif form == "appended" and self.appended:
            source = self.appended[int(part.about.get("offset", -1)) :]
            coded = self.coded
        else:
            raise ValueError(f"{label} has format {form!r} and no data")
        word, size = self.word, self.word.itemsize
        packed = "compressor" in self.root
        first = _decoded(source, 0, size, coded)
        blocks = int(np.frombuffer(first, word, 1)[0])
        if not packed:
            if blocks > len(source):
                raise ValueError(f"{label} is truncated: {blocks} bytes are stated")
            # Writers encode the length with the data, or by itself with padding.
            alone = coded and source[: _letters(size)].endswith(b"=")
            if alone:
                return _decoded(source[_letters(size) :], 0, blocks, True)
            return _decoded(source, size, blocks, coded)
        if blocks * size > len(source):
            raise ValueError(f"{label} is truncated: {blocks} blocks are stated")
        head = (3 + blocks) * size
        sizes = np.frombuffer(_decoded(source, 0, head, coded), word)[3:].astype(np.int64)
        rest = source[_letters(head) if coded else head :]
        stored = _decoded(rest, 0, int(sizes.sum()), coded)
        full, last = (int(n) for n in np.frombuffer(_decoded(source, 0, head, coded), word)[1:3])
        parts = []
        for i, end in enumerate(np.cumsum(sizes).tolist()):
            limit = last if last and i == blocks - 1 else full
            unpack = zlib.decompressobj()
            parts.append(unpack.decompress(stored[end - int(sizes[i]) : end], limit + 1))
            if len(parts[-1]) != limit:
                raise ValueError(f"{label}: block {i} unpacks to {len(parts[-1])} bytes or more, "
                                 f"not to {limit}")  # fmt: skip
        return b"".join(parts)


def _letters(size: int) -> int:
    """Letters of base64 that so many bytes take."""
    return 4 * -(-size // 3)


def _decoded(source: bytes, begin: int, size: int, coded: bool) -> bytes:
    """Some bytes of what may be base64.

    Raises:
        ValueError: there are fewer.
    """
    end = begin + size
    found = base64.b64decode(source[: _letters(end)]) if coded else source[:end]
    if len(found) < end:
        raise ValueError(f"the data are truncated: {len(found)} bytes of {end}")
    return found[begin:end]


def parse_xml(raw: bytes, path: Path) -> Frame:
    """A frame of an XML file; pieces stand one after another.

    Raises:
        ValueError: it is truncated, of another type of data, or compressed otherwise.
    """
    file = XmlFile(raw, path)
    count = {False: _counts(file, ("NumberOfPoints",)),
             True: _counts(file, ("NumberOfPolys", "NumberOfCells"))}  # fmt: skip
    arrays = {}
    for on_faces, section in ((False, "PointData"), (True, "CellData")):
        for part in file.of(section):
            name = part.about.get("Name", "")
            parts = file.of(section, name)
            if len(parts) == len(file.pieces) and part.about.get("type") in TYPES:
                width = int(part.about.get("NumberOfComponents", 1))
                arrays[name] = FrameArray(
                    on_faces, sum(count[on_faces]), width,
                    partial(_joined, file, parts, count[on_faces], width),
                    part.about["type"] == "Float64",
                )  # fmt: skip
    times = file.of("FieldData", "TimeValue")
    time = float(file.values(times[0], 1)[0]) if times else None
    return Frame(partial(_surface, file, count), arrays, time)


def _counts(file: XmlFile, names: tuple[str, ...]) -> list[int]:
    """Points or faces of each piece."""
    if file.kind in ("ImageData", "StructuredGrid"):
        low, high = _extent(file)
        size = high - low + 1 if names[0] == "NumberOfPoints" else np.maximum(high - low, 1)
        return [math.prod(size.tolist())]
    return [next((int(piece[name]) for name in names if name in piece), 0) for piece in file.pieces]


def _extent(file: XmlFile) -> tuple[np.ndarray, np.ndarray]:
    """First and last index of a grid along its axes.

    Raises:
        ValueError: it is in several pieces.
    """
    found = np.array([int(n) for n in file.about_kind.get("WholeExtent", "").split()])
    if len(file.pieces) != 1 or found.shape != (6,) or (found[1::2] < found[::2]).any():
        raise ValueError(f"{file.path} is a grid of {len(file.pieces)} pieces and extent "
                         f"{found.tolist()}; one piece of three axes is needed")  # fmt: skip
    low, high = found[::2], found[1::2]
    require_memory(24 * math.prod((high - low + 1).tolist()), f"{file.path}: points of its grid")
    return low, high


def _joined(file: XmlFile, parts: list[Part], counts: list[int], width: int, axis: int) -> np.ndarray:
    found = [file.values(*each, width, axis) for each in zip(parts, counts, strict=True)]
    return found[0] if len(found) == 1 else np.concatenate(found)


def _surface(file: XmlFile, count: dict[bool, list[int]]) -> Surface:
    """Points and faces of all pieces."""
    if file.kind == "ImageData":
        low, high = _extent(file)
        about = (("Origin", "0 0 0"), ("Spacing", "1 1 1"), ("Direction", "1 0 0 0 1 0 0 0 1"))
        points = image_points(low, high, *(
            np.array([float(n) for n in file.about_kind.get(name, usual).split()])
            for name, usual in about
        ))  # fmt: skip
        return grid_surface(points, high - low + 1)
    points = _stacked(file, "Points", count[False], 3)
    cells = "Polys" if file.kind == "PolyData" else "Cells"
    if file.kind == "StructuredGrid":
        low, high = _extent(file)
        return grid_surface(points, high - low + 1)
    if not sum(count[True]):
        return Surface(points)
    first = np.cumsum([0, *count[False]])
    corners, ends, kinds, done = [], [], [], 0
    pairs = zip(file.of(cells, "offsets"), file.of(cells, "connectivity"), strict=True)
    for i, (offsets, nodes) in enumerate(pairs):
        end = file.values(offsets, count[True][i]).astype(np.int64)
        node = file.values(nodes, int(end[-1])).astype(np.int64) if len(end) else end
        kinds += [file.values(each, len(end)) for each in file.of(cells, "types")[i : i + 1]]
        corners.append(node + first[i])
        ends.append(end + done)
        done += len(node)
    if not corners:
        return Surface(points)
    known = np.concatenate(kinds) if kinds else None
    return Surface(points, np.concatenate(corners), np.concatenate(ends), known)


def _stacked(file: XmlFile, section: str, counts: list[int], width: int) -> np.ndarray:
    """An array of all pieces, float64, (N, width)."""
    pairs: Iterator[Any] = zip(file.of(section), counts, strict=True)
    return np.concatenate([file.values(part, n, width) for part, n in pairs]).astype(np.float64)


def image_points(
    low: np.ndarray, high: np.ndarray, origin: np.ndarray, spacing: np.ndarray,
    direction: np.ndarray,
) -> np.ndarray:  # fmt: skip
    """Points of a uniform grid, x running fastest, (N, 3).

    Args:
        low, high: first and last index along its axes.
        origin, spacing: (3,).
        direction: cosines of its axes, one a column, row by row, (9,).
    """
    axes = [np.arange(a, b + 1) for a, b in zip(low, high, strict=True)]
    places = np.stack(np.meshgrid(*axes[::-1], indexing="ij")[::-1], -1).reshape(-1, 3)
    return origin + (spacing * places) @ direction.reshape(3, 3).T
