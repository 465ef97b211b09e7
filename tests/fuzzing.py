"""Mutations of files and options, and what a command may answer to them.

A mutation leaves the data as they were, or changes them so that an independent, strict reading of the file (here, with
numpy and tomllib alone) either says what they are now or fails. So each answer is judged without knowing the readers:

- an error with exit code 2, in one line that names the file, is always right;
- the answer to the clean file is right as well: what was mutated is not read, or is the same;
- another answer is right only where the strict reading succeeds and differs; of a table of text it must then be the
  answer to the table written anew from what the strict reading found. Of HDF5 no mutation here changes the data.
"""

import contextlib
import io
import json
import math
import re
import signal
import tomllib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import wavfile

from torchliner.cli.main import main

LIMIT = 20  # s of one input
CLOSE = 1e-6  # of two answers, relative: units are converted
NUMBER = re.compile(r"\s*[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?\s*", re.ASCII)


class Hang(BaseException):
    """Out of time; no ``Exception``, so that nothing catches it."""


@dataclass
class Outcome:
    """Of one input: exit code or -1 for what must not be, the answer, what was said."""

    code: int
    answer: Any = None
    said: str = ""

    def fault(self) -> str:
        """Traceback, hang, fault or nothing."""
        if self.code < 0:
            return self.said.partition(":")[0]
        return "traceback" if re.search(r"Traceback|please report it", self.said) else ""


def call(work: Callable[[], Outcome]) -> Outcome:
    """The outcome within ``LIMIT``."""

    def stop(*_: Any) -> None:
        raise Hang

    signal.signal(signal.SIGALRM, stop)
    signal.alarm(LIMIT)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            return work()
    except Hang:
        return Outcome(-1, said="hang")
    except BaseException as error:
        return Outcome(-1, said=f"traceback: {type(error).__name__}: {error}")
    finally:
        signal.alarm(0)


def command(words: list[str], extra: Callable[[], Any] | None = None) -> Outcome:
    """What ``main`` prints as JSON, and what it has written."""

    def work() -> Outcome:
        out, err = io.StringIO(), io.StringIO()
        with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
            try:
                code = main(words)
            except SystemExit as stop:
                code = int(stop.code or 0)
        if code > 1:
            return Outcome(code, said=err.getvalue())
        answer = json.loads(out.getvalue()) if "--json" in words else out.getvalue()
        return Outcome(code, [answer, extra() if extra else None], err.getvalue())

    return call(work)


def same(one: Any, two: Any) -> bool:
    """Whether two answers are the same: numbers nearly, all else exactly."""
    if isinstance(one, dict) and isinstance(two, dict):
        # Hashes of inputs differ with every byte, as they should.
        return one.keys() == two.keys() and all(key == "inputs" or same(one[key], two[key]) for key in one)
    if isinstance(one, (list, tuple)) and isinstance(two, (list, tuple)):
        return len(one) == len(two) and all(map(same, one, two))
    if isinstance(one, str) and isinstance(two, str):  # numbers in a text
        parts = [re.split(r"(-?\d+(?:\.\d+)?(?:e[-+]?\d+)?)", text) for text in (one, two)]
        values = [[float(number) for number in each[1::2]] for each in parts]
        return parts[0][::2] == parts[1][::2] and same(*values)
    numbers = isinstance(one, (int, float)) and isinstance(two, (int, float))
    if numbers and not (math.isnan(one) and math.isnan(two)):
        return one == two or math.isclose(one, two, rel_tol=CLOSE, abs_tol=1e-7)
    return numbers or one == two


def _dropped(answer: Any) -> float:
    """Bursts that a table of stations says are left out."""
    if isinstance(answer, dict):
        own = answer.get("dropped")
        inside = [value for key, value in answer.items() if key != "dropped"]
        here = sum(own.values()) if isinstance(own, dict) else own if isinstance(own, int) else 0
        return here + _dropped(inside)
    return sum(map(_dropped, answer)) if isinstance(answer, list) else 0


# Strict readings: the content of a file as plain values, or None if it has none.


def strict_table(data: bytes) -> bytes | None:
    """A table of text, written anew."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        return None
    lines = re.split(r"\r\n|\n|\r", text)
    head = [line for line in lines if line.strip()]
    remarks = []
    while head and head[0].startswith("#"):
        remarks.append(head.pop(0))
    if not head or "\0" in text:
        return None
    mark = next((each for each in ";\t," if each in head[0]), None)
    labels = [cell.strip() for cell in head[0].split(mark)] if mark else [head[0]]
    if len(set(labels)) < len(labels):
        return None
    rows = []
    for line in head[1:]:
        cells = line.split(mark)
        if len(cells) != len(labels) or not all(map(NUMBER.fullmatch, cells)):
            return None
        if not all(math.isfinite(float(cell)) for cell in cells):
            return None
        rows.append((mark or "").join(repr(float(cell)) for cell in cells))
    written = [*remarks, (mark or "").join(labels), *rows]
    return "\n".join([*written, ""]).encode()


STRICT = {
    ".npy": lambda path: np.load(path, allow_pickle=False).tolist(),
    ".wav": lambda path: [np.asarray(part).tolist() for part in wavfile.read(path)],
    ".toml": lambda path: tomllib.loads(path.read_text(encoding="utf-8-sig")),
}


@dataclass
class Case:
    """A command with a file to mutate; ``run`` gives the outcome of the file as it stands."""

    name: str
    path: Path
    run: Callable[[], Outcome]
    clean: bytes = b""
    answer: Any = None
    counts: dict[str, int] = field(default_factory=dict)
    faults: list[str] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.clean = self.path.read_bytes()
        self.answer = self.run().answer
        assert self.answer is not None, f"{self.name}: {self.run().said}"

    def judge(self, mutation: str, *, may_change: bool) -> None:
        """Run the mutated file and count what came of it; where its data may be others now a strict reading decides."""
        found = self.run()
        fault = found.fault()
        if not fault and found.code > 1 and self.path.name not in found.said:
            fault = "no file named"
        if not fault and found.code <= 1 and not same(found.answer, self.answer):
            fault = self._changed(found) if may_change else "silent wrong"
        kind = fault or {0: "answer", 1: "answer"}.get(found.code, "refused")
        self.counts[kind] = self.counts.get(kind, 0) + 1
        if fault and fault != "other data":
            self.faults.append(f"{self.name}, {mutation}: {fault} {found.said.strip()[-300:]}")

    def _changed(self, found: Outcome) -> str:
        """'other data' where another answer is right, else what is wrong."""
        if self.path.suffix in (".csv", ".txt"):
            written = strict_table(self.path.read_bytes())
            if written is None:
                return "other data" if _dropped(found.answer) > _dropped(self.answer) else "silent wrong"
            self.path.write_bytes(written)
            again = self.run()
            right = again.code == found.code and same(again.answer, found.answer)
            return "other data" if right else "silent wrong"

        try:
            now = STRICT[self.path.suffix](self.path)
        except Exception:
            return "silent wrong"
        self.path.write_bytes(self.clean)
        return "silent wrong" if same(now, STRICT[self.path.suffix](self.path)) else "other data"


# Mutations. Each takes the file, and a ``random.Random``; it returns what it did.

BYTES: dict[str, Callable[[bytes, int, Any], bytes]] = {
    "flip": lambda data, at, draw: data[:at] + bytes([data[at] ^ 1 << draw.randrange(8)]) + data[at + 1 :],
    "put": lambda data, at, draw: data[:at] + bytes([draw.randrange(256)]) + data[at:],
    "take": lambda data, at, draw: data[:at] + data[at + draw.choice((1, 2, 16)) :],
    "cut": lambda data, at, draw: data[:at],
    "zero": lambda data, at, draw: data[:at] + bytes(8) + data[at + 8 :],
    "copy": lambda data, at, draw: data[:at] + data[at : at + draw.choice((4, 64))] + data[at:],
}


def flip_bytes(path: Path, draw: Any) -> str:
    """One to eight bytes changed, put in, taken out, or the end cut off."""
    data, done = path.read_bytes(), []
    for _ in range(draw.choice((1, 1, 2, 8))):
        at, kind = draw.randrange(len(data) or 1), draw.choice(["flip", *BYTES])
        at = draw.choice((at, at, min(at, draw.randrange(1, 4096))))  # structure stands at the beginning
        data = BYTES[kind](data, at, draw) if data else data
        done.append(f"{kind} {at}")
    path.write_bytes(data)
    return ", ".join(done)


CELLS = [
    *"nan NaN inf -inf #N/A 1,5 0,30 1e400 1e300 -1e300 0x10 1_000 \u0661 =1+1 -- 1.5.2 12abc 1e-400 1e +-1".split(),
    *('" "1" \u22121 1;2 true 1j \x1b[2J \0'.split(" ")),
    *("", " ", "1 000", "9" * 400),
]
ROW: dict[str, Callable[[list[str], int, Any], list[list[str]]]] = {  # what comes in the place of the cells of a row
    "cell": lambda cells, at, draw: [[*cells[:at], draw.choice(CELLS), *cells[at + 1 :]]],
    "surplus": lambda cells, at, draw: [[*cells[:at], draw.choice(("1", "0.5", "")), *cells[at:]]],
    "missing": lambda cells, at, draw: [cells[:at] + cells[at + 1 :]],
    "drop": lambda cells, at, draw: [],
    "repeat": lambda cells, at, draw: [cells, cells],
    "blank": lambda cells, at, draw: [draw.choice(([""], ["   "], ["", ""])), cells],
    "comma": lambda cells, at, draw: [[cell.replace(".", ",") for cell in cells]],
    "remark": lambda cells, at, draw: [[f"#{cells[0]}", *cells[1:]]],
}
COLUMN: dict[str, Callable[[list[str], int, int], list[str]]] = {  # of each row
    "twice": lambda cells, at, other: [*cells[:other], cells[at], *cells[other:]],
    "swap": lambda cells, at, other: [cells[{at: other, other: at}.get(i, i)] for i in range(len(cells))],
    "column": lambda cells, at, other: cells[:at] + cells[at + 1 :],
}
WHOLE: dict[str, Callable[[list[str], int, str, Any], list[str]]] = {  # of all lines; the table begins at the number
    "mark": lambda lines, at, mark, draw: [
        *lines[:at],
        *"\n".join(lines[at:]).replace(mark, draw.choice(";\t|")).split("\n"),
    ],
    "order": lambda lines, at, mark, draw: [*lines[: at + 1], *draw.sample(lines[at + 1 :], len(lines) - at - 1)],
    "bom": lambda lines, at, mark, draw: [f"\ufeff{lines[0]}", *lines[1:]],
    "crlf": lambda lines, at, mark, draw: [*(f"{line}\r" for line in lines[:-1]), lines[-1]],
}


def table_cells(path: Path, draw: Any) -> str:
    """Cells, rows or columns of a table of text."""
    lines = path.read_bytes().decode().split("\n")
    first = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), 0)
    mark = next((each for each in ";\t," if each in lines[first]), " ")
    rows = [i for i in range(first, len(lines)) if lines[i].strip()]
    at, kind = draw.choice(rows), draw.choice([*["cell"] * 3, *ROW, *COLUMN, *WHOLE])
    cells = lines[at].split(mark)
    column, other = draw.randrange(len(cells)), draw.randrange(len(cells))
    if kind in ROW:
        lines[at : at + 1] = map(mark.join, ROW[kind](cells, column, draw))
    for i in rows if kind in COLUMN else ():
        one = lines[i].split(mark)
        lines[i] = mark.join(COLUMN[kind](one, column, other) if max(column, other) < len(one) else one)
    lines = WHOLE[kind](lines, first, mark, draw) if kind in WHOLE else lines
    path.write_bytes("\n".join(lines).encode())
    return f"{kind} row {at} column {column}"


def _replace(file: Any, name: str, values: Any = None, **storage: Any) -> Any:
    """A dataset made anew, with its attributes and dimensions."""
    old = file[name]
    about = {key: value for key, value in old.attrs.items() if key not in ("DIMENSION_LIST", "_Netcdf4Dimid")}
    scales = [list(old.dims[i].values()) for i in range(old.ndim)]
    del file[name]
    new = file.create_dataset(name, data=values, **storage)
    new.attrs.update(about)
    for i, each in enumerate(scales[: new.ndim]):
        for scale in each:
            new.dims[i].attach_scale(scale)
    return new


def _unwritten(file: Any, name: str, values: Any) -> None:
    first = max(1, len(values) // 4)
    chunks = (first, *values.shape[1:])
    _replace(file, name, shape=values.shape, dtype=values.dtype, chunks=chunks)[:first] = values[:first]


def _huge(file: Any, name: str, values: Any) -> None:
    rest = values.shape[1:]
    _replace(file, name, shape=(1 << 34, *rest), dtype="f4", chunks=(1024, *rest))


def _linked(file: Any, name: str, link: Any) -> None:
    del file[name]
    file[name] = link


STRUCTURE: dict[str, Callable[[Any, str, Any], Any]] = {  # of an array of numbers
    "rechunk": lambda f, name, v: _replace(f, name, v, chunks=True, compression="gzip", shuffle=True),
    "endian": lambda f, name, v: _replace(f, name, v.astype(v.dtype.newbyteorder(">"))),
    "attribute": lambda f, name, v: f[name].attrs.update(history="by hand"),
    "group": lambda f, name, v: f.create_dataset("elsewhere/v", data=np.arange(3)),
    "pack": lambda f, name, v: _replace(f, name, v * 2).attrs.update(scale_factor=0.5),
    "unwritten": _unwritten,
    "text": lambda f, name, v: _replace(f, name, np.full(v.shape, b"abc")),
    "longer": lambda f, name, v: _replace(f, name, np.concatenate([v, v[:1]])),
    "shorter": lambda f, name, v: _replace(f, name, v[..., :-1]),
    "dangling": lambda f, name, v: _linked(f, name, h5py.SoftLink("/nowhere")),
    "external": lambda f, name, v: _linked(f, name, h5py.ExternalLink("nowhere.h5", "/x")),
    "huge": _huge,
    "complex": lambda f, name, v: _replace(f, name, v.astype(complex)),
    "empty": lambda f, name, v: _replace(f, name, h5py.Empty("f8")),
    "scalar": lambda f, name, v: _replace(f, name, v.flat[0]),
    "bool": lambda f, name, v: _replace(f, name, v > 0),
    "no units": lambda f, name, v: f[name].attrs.pop("units", None),
    "units": lambda f, name, v: f[name].attrs.update(units="furlong"),
    "schema": lambda f, name, v: f.attrs.update(schema="torchliner plane 9"),
}


def hdf5_structure(path: Path, draw: Any) -> str:
    """A dataset of a HDF5 file stored in another way, or spoiled."""
    with h5py.File(path, "r+") as file:
        names: list[str] = []

        def take(name: str, item: Any) -> None:
            if isinstance(item, h5py.Dataset) and item.dtype.kind == "f" and item.size and item.ndim:
                names.extend([name] * (not item.is_scale))

        file.visititems(take)
        name, kind = draw.choice(names), draw.choice(list(STRUCTURE))
        STRUCTURE[kind](file, name, file[name][()])
    return f"{kind} /{name}"
