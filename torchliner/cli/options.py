"""Options: most of them are parameters of public functions, whose signatures and docstrings are read, not imported."""

from __future__ import annotations

import argparse
import ast
import re
from collections.abc import Iterable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from torchliner import names
from torchliner.cli import kinds
from torchliner.cli.kinds import Option
from torchliner.io.whole_file import HDF5 as HDF5

PACKAGE = Path(__file__).resolve().parents[1]


class Parameter(NamedTuple):
    """Of a function, or a field of a dataclass."""

    annotation: str
    default: Any
    text: str


KINDS = {
    "float": kinds.NUMBER,
    "int": kinds.COUNT,
    "complex": kinds.COMPLEX,
    "bool": None,
    "Sequence[float]": kinds.NUMBER,
    "tuple[float, float]": kinds.NUMBER,
}
NARGS = {"background": "+", "Sequence[float]": "+", "tuple[float, float]": 2}
UNITS = {"background": kinds.QUIET, "x": kinds.ARRAY, "z": kinds.ARRAY, "holes": kinds.FILE, "points": kinds.FILE}
LISTS = {
    "averaging": names.AVERAGINGS,
    "phase": names.PHASES,
    "drive": names.DRIVES,
    "mean": names.MEANS,
    "missing": names.MISSING,
    "dtype": names.DTYPES,
    "kernel": names.KERNELS,
    "spacing": names.SPACINGS,
    "interpolation": names.INTERPOLATIONS,
    "window": names.WINDOWS,
    "normal": names.NORMALS,
    "overlap": names.OVERLAPS,
    "condition": names.CONDITIONS,
    "weights": names.WEIGHTS,
    "far_end": names.FAR_ENDS,
    "losses": names.LOSSES,
    "correction": names.CORRECTIONS,
    "flagged": names.FLAGGED,
}


def of(home: str, wanted: str, *, shown: str = "", group: str = "", **changes: dict[str, Any]) -> list[Option]:
    """Options of parameters, with their kinds, defaults and texts.

    Args:
        home: module and name, "velocity.educe:educe".
        wanted: names of parameters, as options without dashes.
        shown: those that --help shows, if not all.
        group: title in the help.
        changes: of fields of an ``Option``, by parameter.
    """
    known, found = parameters(home), []
    for name in wanted.split():
        one = known[name]
        text, plain = one.text.rstrip(".").replace("``", ""), one.annotation.split(" | ")[0]
        if one.default is not None and one.default is not False and not re.search(r"\bdefault\b", text):
            text += f"; default {one.default:g}" if isinstance(one.default, float) else f"; default {one.default}"
        kind: Any = LISTS.get(name) or UNITS.get(name) or KINDS.get(plain, kinds.TEXT)
        about: dict[str, Any] = {"kind": kind, "nargs": NARGS.get(name, NARGS.get(plain)), "text": text, "group": group}
        about |= {"flag": f"--{name.replace('_', '-')}", "further": bool(shown) and name not in shown.split()}
        found.append(Option(**about | changes.get(name, {})))
    return found


@cache
def parameters(home: str) -> dict[str, Parameter]:
    """Of a function or of a dataclass, by name, as the source has them."""
    module, name = home.split(":")
    body = ast.parse((PACKAGE / f"{module.replace('.', '/')}.py").read_text(encoding="utf-8")).body
    node: Any = next(each for each in body if getattr(each, "name", "") == name)
    constants = {ast.unparse(n.targets[0]): n.value for n in body if isinstance(n, ast.Assign)}
    pairs: dict[str, tuple[Any, Any]] = {}
    if isinstance(node, ast.ClassDef):
        pairs = {ast.unparse(n.target): (n.annotation, n.value) for n in node.body if isinstance(n, ast.AnnAssign)}
    else:
        usual, keywords = node.args.args, node.args.kwonlyargs
        values = [None] * (len(usual) - len(node.args.defaults)) + node.args.defaults + node.args.kw_defaults
        pairs = {a.arg: (a.annotation, v) for a, v in zip([*usual, *keywords], values, strict=True)}
    texts = _texts(ast.get_docstring(node) or "")
    return {
        name: Parameter(ast.unparse(annotation), _value(default, constants), texts.get(name, ""))
        for name, (annotation, default) in pairs.items()
    }


def _value(default: ast.expr | None, constants: dict[str, ast.expr]) -> Any:
    """A literal, or a constant of the module; None for all else."""
    if isinstance(default, ast.Name):
        default = constants.get(default.id)
    try:
        return None if default is None else ast.literal_eval(default)
    except ValueError:
        return None


def _texts(docstring: str) -> dict[str, str]:
    """What Args says of each parameter; names before one colon share a text."""
    section = re.search(r"^Args:\n((?: +.*\n)+)", docstring + "\n", re.MULTILINE)
    found = {}
    for entry in re.split(r"\n(?=    \S)", section[1].rstrip() if section else ""):
        known, _, text = entry.partition(": ")
        found.update(dict.fromkeys(known.replace(",", " ").split(), " ".join(text.split())))
    return found


def group(title: str, *options: Option, further: bool = False) -> list[Option]:
    """Options under a title; ``further``: they wait for --help-all."""
    return [replace(each, group=title, further=each.further or further) for each in options]


def output(text: str, *endings: str, required: bool = False, flag: str = "--output") -> Option:
    """A file with one of the endings, or a folder for one with the first."""
    kind = kinds.Kind("FILE", Path, "written", endings)
    return Option(flag, f"{text} as {', '.join(endings)}", kind, required=required)


def frequency(default: str, flag: str = "--frequency") -> Option:
    """Values or ranges of frequency; ``default`` in words."""
    return Option(flag, f"values in Hz, or ranges LOW:HIGH:STEP; default: {default}", kinds.FREQUENCIES, nargs="+")


def averaging(default: str | None, *of: str) -> Option:
    """--averaging with its own default; ``of``: some of the averagings alone."""
    known = {name: names.AVERAGINGS[name] for name in of or names.AVERAGINGS}
    words = "; ".join(f"{name}, {text}" for name, text in known.items())
    return Option("--averaging", f"over cells: {words}; default: {default or 'that of the map'}", known, None, default)


def choices(wanted: str, **changes: dict[str, Any]) -> list[Option]:
    """Options of ``Choices``; all but ``SHOWN`` wait for --help-all."""
    found = of("velocity.choices:Choices", wanted, shown=SHOWN, group="choices", **changes)
    return found + ([NO_INTERVALS] if "interval" in wanted.split() else [])


SHOWN = (  # by --help
    "averaging phase drive mean interval background level_matched wall_filter device dtype kernel window segment"
)
OF_EDUCE = (
    "drive running_window mean wall_filter missing background minimum_coherence interval level_limit "
    "level_uncertainty level_matched allow_short device dtype"
)
NO_INTERVALS = Option("--no-intervals", "no error bars", further=True, group="choices")
NO_GIVEN_PHASE = {"kind": [rule for rule in names.PHASES if rule != "given"]}
PHASE = of("velocity.educe:educe", "reference_phase", group="choices", reference_phase={"kind": kinds.NUMBER})
EDUCED = [*choices("averaging phase"), *PHASE, *choices(OF_EDUCE)]
SELECTION = of("io.planes:read_plane", "start stop every region", group="part of the data")
STATED = of(
    "io.plane_format:PlaneRequest",
    "variable group axes velocity_units length_units sampling_rate normal row wall_normal_component x z points holes "
    "overlap",
    group="missing metadata",
)
READING = [replace(each, further=True) for each in (*SELECTION, *STATED)]

RESULT = (*HDF5, *names.RESULT_WRITERS)
ONE_PLANE, PLANES = (
    Option("plane", "file of a plane, of any format; 'run_*.nc' joins restarts", kinds.PLANE),
    Option("planes", "files of planes, of any format; 'run_*.nc' joins restarts", kinds.PLANE, nargs="+"),
)
OF_LINER = Option(
    "--liner", "preset, or .toml, .csv or .py file of a model; default: the one the file names", kinds.LINER
)
TONE = frequency("the tone of the file")
ONE_TONE = Option("--frequency", "default: the tone of the file", kinds.HZ)
ROWS = output("write the rows", ".csv")
COPY = output("write the preset, to edit,", ".toml", flag="--copy")
PICTURES_OF = Option("--figure", "draw pictures there", kinds.FOLDER)
PRINTING = [
    Option("--json", "print JSON instead of a table"),
    Option("--verbose", "print all there is, and every warning"),
    Option("--quiet", "no progress bar, no warnings"),
]
STRICT = Option("--strict", "exit code 1 where the level check fails for the answer")
WAVES = "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), or a .wav or .npy file"
INCIDENT = [
    Option("--incident", f"{WAVES}; default: tones of --frequency", kinds.SIGNAL),
    Option("--incident-rate", "sampling rate of an .npy file, Hz; default: none", kinds.HZ),
]
WORKERS = "that read the data: local:N, N processes here; tcp://HOST:PORT of a dask scheduler, or its .json file"
CLUSTER = [
    Option("--cluster", f"workers {WORKERS}; default: none, this process", kinds.TEXT),
    Option("--wait", "for its scheduler and its first worker, s; default 30", kinds.S),
]
SPL = "of the incident wave (normal incidence) or at the wall (grazing), dB re 20 uPa rms"
CASE = [
    Option("--frequency", "tone in Hz", kinds.HZ),
    Option("--incident-level", SPL, kinds.DB),
    Option("--mach", "bulk Mach number", kinds.NUMBER),
    Option("--displacement-thickness", "of the boundary layer, m", kinds.M),
    Option("--source-side", "side that the sound comes from", [s for s in names.SOURCE_SIDES if s != "unknown"]),
    Option("--liner", "name of the liner below", kinds.TEXT),
    Option("--title", "of tables and figures", kinds.TEXT),
]  # facts that a file may leave unsaid


def figure(text: str) -> Option:
    """--figure, a picture."""
    return Option("--figure", text, kinds.PICTURE)


def given(options: argparse.Namespace, declared: Iterable[Option]) -> dict[str, Any]:
    """Those of the options that the user gave, by name; ``interval`` None with --no-intervals."""
    every: dict[str, Any] = {each.dest: getattr(options, each.dest, None) for each in declared}
    found = {key: value for key, value in every.items() if value is not None and value is not False}
    if "background" in found:
        found["background"] = _background(found["background"])
    if not found.pop("no_intervals", False):
        return found
    if "interval" in found:
        raise ValueError("--no-intervals leaves out what --interval is of; name one of them")
    return found | {"interval": None}


def _background(words: Sequence[str]) -> Any:
    """A number in m/s, or planes or moments without sound."""
    import torchliner as tl
    from torchliner.io.moments_file import holds_moments

    try:
        (word,) = words
        return float(word)
    except ValueError:
        return [tl.read_moments(each) if holds_moments(each) else tl.read_plane(each, lazy=True) for each in words]


def require_alone(options: argparse.Namespace, remedy: str, *kept: str) -> None:
    """Refuse options that a command which only lists or copies presets would not use.

    Raises:
        ValueError: there are some; ``remedy`` says what they need.
    """
    declared = [*options.declared.options, *options.declared.chosen]
    if unused := sorted(key for key, value in given(options, declared).items() if key not in kept and value != []):
        raise ValueError(f"{spelled(unused)}: of no use here; {remedy}")


def spelled(keys: Iterable[str]) -> str:
    """Options by their attributes, as they are typed: "--in-situ, --quiet"."""
    return ", ".join(f"--{key.replace('_', '-')}" for key in keys)
