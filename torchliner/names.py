"""What can be chosen, by name: the one list that library, commands and docs share; the names of files and frequencies.

With the standard library alone, so that the command line stays quick. Where a name stands for a piece of code, the
table of that code is keyed by it, and a test holds the two together.
"""

import difflib
import importlib
import re
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

__version__ = "0.1.0"

MOST_FREQUENCIES = 10_000  # of one range: more is a slip of the step

# An eduction.
DRIVES = ("instantaneous", "rms", "running-rms")
MEANS = ("kept", "removed")
KERNELS = ("two-sided", "causal")
STEP_KERNELS = ("least-squares", "causal")  # of IR-TDIBC
SPACINGS = ("sqrt", "uniform")
INTERPOLATIONS = ("cubic", "linear")
WINDOWS = ("hann", "boxcar")
MISSING = ("refuse", "exclude")
OVERLAPS = ("refuse", "later", "earlier")  # of files of one run
DTYPES = ("float32", "float64")
AVERAGINGS = {  # over the probes of a cell: what is averaged
    "admittance": "of the admittance: each probe is driven by its own v (the paper)",
    "velocity": "of v, whose average drives the liner",
    "phase-locked": "of what of v is periodic with the tone; the rest acts where it is",
}
PHASES = {  # of the incident tone relative to v; the rules: velocity.averages.PHASE_RULES
    "averaged": "over all phases: nothing else is known",
    "self-consistent": "from v's own part at the tone",
    "given": "stated by reference_phase",
}
UNHEARD = {"averaged", "given"}  # of these: rules that need no tone in v

# Records and liners.
FLOW_PROFILES = ("uniform", "tanh", "parabolic")  # stated by numbers
LINER_MODELS = {  # classes by the ``model`` of liner files, whose keys are their fields
    "sdof": "torchliner.liners.sdof:SDoFLiner",
    "sdof-end-loss": "torchliner.liners.sdof:EndLossSDoFLiner",
    "table": "torchliner.liners.tabulated:TabulatedLiner",
    "adjusted-sdof": "torchliner.liners.sdof:AdjustedSDoFLiner",
    "layered": "torchliner.liners.layered:LayeredLiner",
}
SOURCE_SIDES = ("upstream", "downstream", "normal", "none", "unknown")
VELOCITY_READINGS = ("as_measured", "conserved")

# Bursts and lines of stations.
GRID_METHODS = ("linear", "hold", "band-limited")
STATION_WINDOWS = ("whole-periods", "hann")
CORRECTIONS = ("none", "tone")
FILTERS = ("times", "zero-runs", "outliers")
FLAGGED = ("exclude", "use")
SEPARATORS = {"blank": None, "tab": "\t", "comma": ",", "semicolon": ";"}  # of columns of text

# Ducts and pressures.
SOURCES = ("upstream", "downstream")
DIRECTIONS = ("downstream", "upstream")  # of waves, along the flow first
WALLS = ("opposite", "lined")
CONDITIONS = ("ingard-myers", "continuous-velocity")
FAR_ENDS = ("fitted", "stated")
LOSSES = ("none", "viscothermal")
_HERE = "torchliner.pressure"
WALL_METHODS = {  # from microphones: where the function of a line stands, what it is, its options
    "kt": (f"{_HERE}.waves:kumaresan_tufts", "Kumaresan-Tufts", ("condition", "margin", "rank", "order")),
    "two-waves": (f"{_HERE}.two_waves:two_wave_fit", "two waves tied by one impedance", ("condition", "margin")),
    "field": (f"{_HERE}.fit_field:fit_field", "field of the linearised Euler equations", ("duct", "far_end", "start")),
}

# Files. A new format is a file with the function and a row here.
ARRAY_ENDINGS = (".npy", ".mat", ".h5", ".hdf5", ".nc")  # of files of which an array is named
RESULT_WRITERS = {  # beside .h5: functions of a result and a path
    ".csv": "torchliner.io.result_writers:write_result_csv",
    ".vtp": "torchliner.io.result_writers:write_vtk",
    ".vtkhdf": "torchliner.io.result_writers:write_vtk",
    ".txt": "torchliner.io.result_writers:write_solver_table",
}
PLANE_FORMATS = {  # objects of the class PlaneFormat; the first that recognises a file reads it
    "powerflow": "torchliner.io.powerflow:FORMAT",
    "openfoam-probes": "torchliner.io.openfoam:PROBES",
    "openfoam-surfaces": "torchliner.io.openfoam:SURFACES",
    "vtk": "torchliner.io.vtk:FORMAT",
    "matlab": "torchliner.io.foreign:MATLAB_FORMAT",
    "npy": "torchliner.io.foreign:NPY_FORMAT",
    "csv": "torchliner.io.histories:FORMAT",
    "zarr": "torchliner.io.foreign:STORE",
    "netcdf3": "torchliner.io.foreign:NETCDF3",
    "hdf5": "torchliner.io.foreign:HDF5",  # behind all others that are HDF5 inside
}


def did_you_mean(word: str, known: Sequence[str], likeness: float = 0.5) -> str:
    """' (did you mean ...?)' or nothing; ``likeness``, 0 to 1, that a known word needs."""
    if word in known:
        return ""
    near = difflib.get_close_matches(word, known, n=1, cutoff=likeness)
    return f" (did you mean {near[0]!r}?)" if near else ""


def resolve(home: str) -> Any:
    """What "module:name" of a table stands for, imported when it is asked for."""
    module, name = home.split(":")
    return getattr(importlib.import_module(module), name)


def frequencies(text: str) -> list[float]:
    """Frequencies as they are typed: one, or LOW:HIGH:STEP with both ends; ValueError for anything else."""
    numbers = [float(part) for part in text.split(":")]
    if len(numbers) == 1:
        return numbers
    low, high, step = numbers
    if not (step > 0 and low <= high < float("inf") and (high - low) / step < MOST_FREQUENCIES):
        raise ValueError(text)
    return [low + i * step for i in range(int((high - low) / step + 1e-9) + 1)]


def unique_names(paths: Iterable[str | Path]) -> list[str]:
    """Stems of files; whole paths where two are the same."""
    every = [Path(path) for path in paths]
    stems = [path.stem for path in every]
    return stems if len(set(stems)) == len(stems) else [re.sub(r"\W+", "_", str(path)).strip("_") for path in every]


def frequency_ends(frequencies: Sequence[float]) -> list[str]:
    """Endings ``_1400Hz`` of file names; none for one."""
    return [""] if len(frequencies) == 1 else [f"_{f:.9g}Hz" for f in frequencies]
