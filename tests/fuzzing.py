"""Mutations of files and options, and what a command may answer to them.

A mutation leaves the data as they were, or changes them so that an independent, strict reading of
the file (here, with h5py, numpy and tomllib alone) either says what they are now or fails. So each
answer is judged without knowing the readers:

- an error with exit code 2, in one line that names the file, is always right;
- the answer to the clean file is right as well: what was mutated is not read, or is the same;
- another answer is right only where the strict reading succeeds and differs; of a table of text it
  must then be the answer to the table written anew from what the strict reading found.
"""

from __future__ import annotations

import contextlib
import io
import json
import math
import os
import pickle
import re
import select
import signal
import tomllib
import warnings
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from scipy.io import loadmat, wavfile

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


def in_child(work: Callable[[], Outcome]) -> Outcome:
    """The outcome in a process of its own: a library in a loop, or that crashes, ends with it."""
    reader, writer = os.pipe()
    child = os.fork()
    if child == 0:
        with contextlib.suppress(BaseException):
            os.close(reader)
            os.write(writer, pickle.dumps(work())[: 1 << 22])
        os._exit(0)
    os.close(writer)
    found, pipe = b"", io.FileIO(reader)
    while select.select([pipe], [], [], LIMIT + 5)[0]:
        part = pipe.read(1 << 16)
        if not part:
            break
        found += part
    else:
        os.kill(child, signal.SIGKILL)
    pipe.close()
    _, status = os.waitpid(child, 0)
    if os.WIFSIGNALED(status):
        return Outcome(-1, said="hang" if os.WTERMSIG(status) == 9 else "crash")
    with contextlib.suppress(Exception):
        return pickle.loads(found)
    return Outcome(-1, said="traceback: no answer of the child")


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


def _without_gaps(found: Any, clean: Any) -> Any:
    """An answer with what it says is missing put in from another."""
    if isinstance(found, dict) and isinstance(clean, dict):
        return {key: _without_gaps(value, clean.get(key)) for key, value in found.items()}
    if isinstance(found, list) and isinstance(clean, list) and len(found) == len(clean):
        return [_without_gaps(*pair) for pair in zip(found, clean, strict=True)]
    return clean if found is None or (isinstance(found, float) and math.isnan(found)) else found


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


def strict_hdf5(path: Path) -> Any:
    """Every dataset and attribute."""
    found: dict[str, Any] = {}

    def take(name: str, item: Any) -> None:
        if isinstance(item, h5py.Dataset):
            found[name] = (item.shape, str(item.dtype.kind), item[()].tolist())
        for key, value in item.attrs.items():
            if key not in ("DIMENSION_LIST", "REFERENCE_LIST"):
                found[f"{name}@{key}"] = np.asarray(value).tolist()

    with h5py.File(path, "r", locking=False) as file:
        take("", file)
        file.visititems(take)
    return found


def strict_matlab(path: Path) -> Any:
    """Every variable."""
    return {k: np.asarray(v).tolist() for k, v in loadmat(path).items() if not k.startswith("_")}


STRICT = {
    ".h5": strict_hdf5,
    ".npy": lambda path: np.load(path, allow_pickle=False).tolist(),
    ".mat": strict_matlab,
    ".wav": lambda path: [np.asarray(part).tolist() for part in wavfile.read(path)],
    ".toml": lambda path: tomllib.loads(path.read_text(encoding="utf-8-sig")),
}


@dataclass
class Case:
    """A command with a file to mutate.

    Args:
        name: of the case.
        path: of the file that is mutated; its clean bytes are kept.
        run: the outcome of the file as it stands.
    """

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
        """Run the mutated file and count what came of it.

        Args:
            mutation: what was done, to do it again by hand.
            may_change: the data may be others now: a strict reading decides.
        """
        # What is wrong in the structure itself may end the process, or never come to an end.
        child = self.path.suffix in (".h5", ".mat") and mutation.startswith(STEPS)
        found = in_child(self.run) if child else self.run()
        fault = found.fault()
        if fault in ("crash", "hang") and child and self._library_breaks(fault):
            self.counts["library"] = self.counts.get("library", 0) + 1
            return
        if not fault and found.code > 1 and self.path.name not in found.said:
            fault = "no file named"
        if not fault and found.code <= 1 and not same(found.answer, self.answer):
            fault = self._changed(found, mutation, may_change)
        kind = fault or {0: "answer", 1: "answer"}.get(found.code, "refused")
        self.counts[kind] = self.counts.get(kind, 0) + 1
        if fault and fault != "other data":
            self.faults.append(f"{self.name}, {mutation}: {fault} {found.said.strip()[-300:]}")

    def _library_breaks(self, fault: str) -> bool:
        """Whether h5py or scipy alone end the same way: that is out of our hands."""

        def strict() -> Outcome:
            with contextlib.suppress(Exception):
                STRICT[self.path.suffix](self.path)
            return Outcome(0)

        return in_child(lambda: call(strict)).fault() == fault

    def _changed(self, found: Outcome, mutation: str, may_change: bool) -> str:
        """'other data' where another answer is right, else what is wrong."""
        if mutation.startswith(("nan", "fill")) and same(_without_gaps(found.answer, self.answer), self.answer):
            return "other data"  # what the file marks as missing is told as missing
        if not may_change:
            return "silent wrong"
        if self.path.suffix in (".csv", ".txt"):
            written = strict_table(self.path.read_bytes())
            if written is None:
                return "other data" if _dropped(found.answer) > _dropped(self.answer) else "silent wrong"
            self.path.write_bytes(written)
            again = self.run()
            right = again.code == found.code and same(again.answer, found.answer)
            return "other data" if right else "silent wrong"

        def differs() -> Outcome:
            read = STRICT[self.path.suffix]
            now = read(self.path)
            self.path.write_bytes(self.clean)
            return Outcome(0 if same(now, read(self.path)) else 1)

        told = in_child(lambda: call(differs))
        return "other data" if told.code == 1 else "silent wrong"


# Mutations. Each takes the file, and a ``random.Random``; it returns what it did.


STEPS = ("flip", "put", "take", "cut", "zero", "copy")


def flip_bytes(path: Path, draw: Any) -> str:
    """One to eight bytes changed, put in, taken out, or the end cut off."""
    data = bytearray(path.read_bytes())
    done = []
    for _ in range(draw.choice((1, 1, 2, 8))):
        at = draw.randrange(len(data)) if data else 0
        # Structure stands at the beginning and between the data.
        at = draw.choice((at, at, min(at, draw.randrange(1, 4096))))
        kind = draw.choice(("flip", *STEPS))
        if kind == "flip" and data:
            data[at] ^= 1 << draw.randrange(8)
        elif kind == "put":
            data[at:at] = bytes([draw.randrange(256)])
        elif kind == "take":
            del data[at : at + draw.choice((1, 2, 16))]
        elif kind == "cut":
            del data[at:]
        elif kind == "zero":
            data[at : at + 8] = bytes(8)
        else:
            data[at:at] = data[at : at + draw.choice((4, 64))]
        done.append(f"{kind} {at}")
    path.write_bytes(data)
    return ", ".join(done)


CELLS = [
    *"nan NaN inf -inf #N/A 1,5 0,30 1e400 1e300 -1e300 0x10 1_000 \u0661 =1+1 -- 1.5.2 12abc 1e-400 1e +-1".split(),
    *('" "1" \u22121 1;2 true 1j \x1b[2J \0'.split(" ")),
    *("", " ", "1 000", "9" * 400),
]
TABLE_KINDS = (
    "cell cell cell cell surplus missing twice swap drop repeat order blank mark comma remark bom crlf column"
).split()


def table_cells(path: Path, draw: Any) -> str:
    """Cells, rows or columns of a table of text."""
    text = path.read_bytes().decode()
    lines = text.split("\n")
    first = next((i for i, line in enumerate(lines) if line.strip() and line[0] != "#"), 0)
    mark = next((each for each in ";\t," if each in lines[first]), " ")
    rows = [i for i in range(first, len(lines)) if lines[i].strip()]
    at, kind = draw.choice(rows), draw.choice(TABLE_KINDS)
    cells = lines[at].split(mark)
    column = draw.randrange(len(cells))
    said = f"{kind} row {at} column {column}"
    if kind == "cell":
        cells[column] = draw.choice(CELLS)
        said += f" {cells[column]!r}"
    elif kind == "surplus":
        cells.insert(column, draw.choice(("1", "0.5", "")))
    elif kind == "missing":
        del cells[column]
    lines[at] = mark.join(cells)
    if kind in ("twice", "swap", "column"):
        other = draw.randrange(len(cells))
        for i in rows:
            one = lines[i].split(mark)
            if max(column, other) < len(one):
                if kind == "twice":
                    one.insert(other, one[column])
                elif kind == "swap":
                    one[column], one[other] = one[other], one[column]
                else:
                    del one[column]
            lines[i] = mark.join(one)
    elif kind == "drop":
        del lines[at]
    elif kind == "repeat":
        lines.insert(at, lines[at])
    elif kind == "order":
        lines[first + 1 :] = draw.sample(lines[first + 1 :], len(lines) - first - 1)
    elif kind == "blank":
        lines.insert(at, draw.choice(("", "   ", mark)))
    elif kind == "mark":
        new = draw.choice(";\t|")
        lines[first:] = [line.replace(mark, new) for line in lines[first:]]
    elif kind == "comma":
        lines[at] = lines[at].replace(".", ",")
    elif kind == "remark":
        lines[at] = f"#{lines[at]}"
    text = "\n".join(lines)
    text = f"\ufeff{text}" if kind == "bom" else text.replace("\n", "\r\n") if kind == "crlf" else text
    path.write_bytes(text.encode())
    return said


def _replace(file: Any, name: str, values: Any, keep: bool = True, **storage: Any) -> Any:
    """A dataset made anew, with its attributes and dimensions."""
    old = file[name]
    about = {
        k: v
        for k, v in old.attrs.items()
        if k not in ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME", "_Netcdf4Dimid")
    }
    scale = old.is_scale
    labels = [[other.name for other in old.dims[i].values()] for i in range(old.ndim)]
    users = []
    if scale:
        for key, item in file.items():
            if isinstance(item, h5py.Dataset):
                users += [(key, i) for i in range(item.ndim) if old in item.dims[i].values()]
        for key, i in users:
            file[key].dims[i].detach_scale(old)
    del file[name]
    new = file.create_dataset(name, data=values, **storage) if keep else file.create_dataset(name, **storage)
    new.attrs.update(about)
    if scale:
        new.make_scale(name)
        for key, i in users:
            if file[key].shape[i : i + 1] == (new.shape or (None,))[:1]:  # None: without a value
                file[key].dims[i].attach_scale(new)
    for i, names in enumerate(labels[: new.ndim]):
        for label in names:
            if label in file and label.strip("/") != name:
                new.dims[i].attach_scale(file[label])
    return new


def hdf5_structure(path: Path, draw: Any) -> tuple[str, bool]:
    """A dataset or attribute of a HDF5 file; and whether the data are others then."""
    with h5py.File(path, "r+") as file:
        names: list[str] = []
        file.visititems(lambda k, v: names.append(k) if isinstance(v, h5py.Dataset) else None)
        name = draw.choice(names)
        data, values = file[name], file[name][()]
        number = np.asarray(values).dtype.kind in "fiu"
        array = number and data.ndim > 0 and data.size > 0
        kind = draw.choice(
            "units nounits rechunk endian attr dataset group pack offset fill unwritten text shape "
            "longer dangling huge nan inf delete schema json badattr complex empty external scalar "
            "negate bool".split()
        )
        said = f"{kind} /{name}"
        if kind == "units":
            data.attrs["units"] = draw.choice(("furlong", "kHzz", "", "m/s/s", "5", "K"))
        elif kind == "nounits":
            data.attrs.pop("units", None)
        elif kind == "rechunk" and array:
            _replace(file, name, values, chunks=True, compression="gzip", shuffle=True)
        elif kind == "endian" and array:
            _replace(file, name, values.astype(values.dtype.newbyteorder(">")))
        elif kind == "attr":
            draw.choice((file, data)).attrs["history"] = "by hand"
        elif kind == "dataset":
            file["something_else"] = np.arange(3)
        elif kind == "group":
            file.create_group("elsewhere")["v"] = np.arange(3)
        elif kind == "pack" and number and values.dtype.kind == "f":
            new = _replace(file, name, values / values.dtype.type(0.5))
            new.attrs["scale_factor"] = 0.5
        elif kind == "offset" and number and values.dtype.kind == "f":
            new = _replace(file, name, values - values.dtype.type(8))
            new.attrs["add_offset"] = 8.0
        elif kind == "fill" and array and values.dtype.kind == "f":
            values = values.copy()
            values.flat[draw.randrange(values.size)] = -99
            _replace(file, name, values).attrs["_FillValue"] = values.dtype.type(-99)
        elif kind == "unwritten" and array:
            first = max(1, len(values) // 4)
            new = _replace(
                file, name, None, keep=False, shape=values.shape, dtype=values.dtype, chunks=(first, *values.shape[1:])
            )
            new[:first] = values[:first]
        elif kind == "text":
            _replace(file, name, np.full(np.shape(values), b"abc"))
        elif kind == "shape" and array:
            _replace(file, name, np.delete(values, -1, draw.randrange(data.ndim)))
        elif kind == "longer" and array:
            axis = draw.randrange(data.ndim)
            _replace(file, name, np.concatenate([values, values.take([0], axis)], axis))
        elif kind == "dangling":
            del file[name]
            file[name] = h5py.SoftLink("/nowhere")
        elif kind == "external":
            del file[name]
            file[name] = h5py.ExternalLink("nowhere.h5", "/x")
        elif kind == "huge":
            shape = tuple(1 << 34 if i == 0 else n for i, n in enumerate(np.shape(values) or (1,)))
            _replace(file, name, None, keep=False, shape=shape, dtype="f4", chunks=(1024, *shape[1:]))
        elif kind in ("nan", "inf") and number and values.dtype.kind == "f":
            values = np.array(values)
            values.flat[draw.randrange(values.size)] = float(kind)
            _replace(file, name, values)
            result = re.search("torchliner (map|line|points) ", str(file.attrs.get("schema")))
            return said, bool(result)  # where an interval may be infinite or unknown
        elif kind == "delete":
            del file[name]
            return said, True  # of what may be left out the answer is another one
        elif kind == "schema":
            file.attrs["schema"] = draw.choice(("torchliner plane 9", "", "x", 5))
        elif kind == "json":
            key = draw.choice(list(file.attrs) or ["history"])
            file.attrs[key] = draw.choice(("{", "[1", '{"a": NaN}', "[" * 5000, "null", "7", "[]"))
            return f"{kind} @{key}", True
        elif kind == "badattr":
            where = draw.choice((file, data))
            key = draw.choice(list(where.attrs) or ["units"])
            if key not in ("DIMENSION_LIST", "REFERENCE_LIST", "CLASS", "NAME"):
                where.attrs[key] = draw.choice((5, b"\xff\xfe", np.arange(3), np.nan, h5py.Empty("f")))
            return f"{kind} {where.name}@{key}", True
        elif kind == "complex" and array:
            _replace(file, name, values.astype(complex))
        elif kind == "empty":
            _replace(file, name, h5py.Empty("f8"))
        elif kind == "scalar" and array:
            _replace(file, name, values.flat[0])
        elif kind == "negate" and number and values.dtype.kind == "f":
            _replace(file, name, -values)
            return said, True
        elif kind == "bool" and array:
            _replace(file, name, np.asarray(values) > 0)
    return said, False
