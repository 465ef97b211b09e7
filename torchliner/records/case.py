"""What is stated of a measurement or a result beside its numbers, what records of signals at probes share, and whether
several records belong to one case."""

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import KW_ONLY, field
from typing import Any, ClassVar

import numpy as np
from torch import Tensor

from torchliner.checks import require_positive
from torchliner.fluid import Fluid
from torchliner.names import SOURCE_SIDES
from torchliner.records.checked import check
from torchliner.records.declared import ANY, part, record, var
from torchliner.records.level_check import DEGREES_PER_DB, UNKNOWN, LevelCheck
from torchliner.records.notes import Note

LOUDEST = 194.0  # dB: one atmosphere rms
LEVELS = f"[-126, {LOUDEST:g}]"  # from its last digit in double precision
SAME_PLACE = 1e-6  # m
STATED = ("liner", "mach", "incident_level", "source_side")  # the same at all heights above one liner
OF_ONE_PLANE = (*STATED, "height", "frequency")
OF_ONE_RUN = ("frequency", "incident_level", "mach")


@record
class Stated:
    """Facts of a case.

    Args:
        fluid: gas of the data.
        source_side: where the sound comes from, one of ``SOURCE_SIDES``.
        reference: independent impedances of the same case, normalised, by name ("true", "in situ").
        title: where the data come from.
    """

    _: KW_ONLY
    fluid: Fluid = field(default_factory=Fluid)
    mach: float | None = var(text="bulk Mach number, x counting along the flow", range="[0, 1)", default=None)
    source_side: str = field(default="unknown", metadata={"choices": SOURCE_SIDES})
    reference: Mapping[str, complex] = field(default_factory=dict)
    title: str = ""


@record
class Case(Stated):
    """Facts of a measurement.

    Args:
        liner: name of the liner below, if one is known; "hard wall" is a liner too.
        provenance: where the data come from.
        name: how messages call it (a file's name).
    """

    _: KW_ONLY
    liner: str = ""
    provenance: Mapping[str, Any] = field(default_factory=dict)
    name: str = "record"


@record
class OfOneTone(Case):
    """Facts of a measurement with one tone."""

    _: KW_ONLY
    frequency: float | None = var(unit="Hz", text="of the tone", range="(0, inf)", default=None)
    incident_level: float | None = var(unit="dB", text="nominal SPL, re 20 uPa", range=LEVELS, default=None)
    displacement_thickness: float | None = var(unit="m", text="delta* of the flow", range="[0, inf)", default=None)


@record
class AtProbes(OfOneTone):
    """Uniform samples at probes, and the coordinates of these.

    Args:
        sampling_rate: Hz.
    """

    _: KW_ONLY
    sampling_rate: float
    start: float = var(unit="s", text="time of the first sample", range=ANY, default=0.0)
    x: Any = var("columns", unit="m", kind="places", default=None, text="streamwise, columns or probes")
    z: Any = var("rows", unit="m", kind="places", default=None, text="spanwise, of rows or probes")

    UNSAID: ClassVar = ("sampling_rate", "start", "name")  # in its file: times and the file's name

    def __post_init__(self) -> None:
        check(self)
        shape = self._shape
        require_positive(f"{self.name}: sampling_rate (Hz)", self.sampling_rate)
        if not 0 < len(shape) <= 3 or 0 in shape:
            raise ValueError(f"{self.name}: a signal has shape {shape}; give (z, x, time), (x, time) or (probe, time)")
        for label, along in {"x": -1, "z": 0}.items():
            wanted = shape[:-1][along] if len(shape) == 3 else self.probes
            if (value := getattr(self, label)) is not None and len(value) != wanted:
                raise ValueError(
                    f"{self.name}: {label} has {len(value)} values; probes of shape {self.probe_shape} need {wanted}"
                )

    @property
    def _shape(self) -> tuple[int, ...]:
        """Of its signals, time last."""
        raise NotImplementedError

    @property
    def samples(self) -> int:
        """T."""
        return self._shape[-1]

    @property
    def probe_shape(self) -> tuple[int, ...]:
        """(z, x), (probe,) or ()."""
        return self._shape[:-1]

    @property
    def probes(self) -> int:
        """Their number, 1 without axes."""
        return math.prod(self._shape[:-1])

    @property
    def duration(self) -> float:
        """T / sampling_rate, s."""
        return self.samples / self.sampling_rate

    @property
    def axes(self) -> dict[str, tuple[str, ...]]:
        """Dimensions of its file; probes whose x rises, without z, are a line."""
        line = self.x is not None and self.z is None and bool((self.x.diff() > 0).all())
        return probe_axes(self.probe_shape, line)

    def place(self, probe: Any) -> tuple[int, ...]:
        """Of one probe, by its number among all, on the probe axes."""
        return tuple(map(int, np.unravel_index(int(probe), self.probe_shape)))

    def probe_coordinates(self) -> tuple[Tensor | None, Tensor | None]:
        """x and z of every probe, m, each (P,) or None."""
        x, z = self.x, self.z
        if len(self.probe_shape) == 2:
            rows, columns = self.probe_shape
            x = None if x is None else x.repeat(rows)
            z = None if z is None else z.repeat_interleave(columns)
        return x, z


def probe_axes(shape: tuple[int, ...], line: bool = False) -> dict[str, tuple[str, ...]]:
    """Dimensions of probes: z and x of a surface, else ``probe``, or x along a ``line``; none of a single probe."""
    if len(shape) == 2:
        return {"probes": ("z", "x"), "columns": ("x",), "rows": ("z",)}
    return dict.fromkeys(("probes", "columns", "rows"), () if not shape else ("x",) if line else ("probe",))


@record
class Found(Stated):
    """What every educed result holds.

    Args:
        choices: every option and what followed from it.
        notes: warnings.
        level_check: whether Z and the phase-locked velocity give the pressure that is known; None where that is not
            checked, see ``level_check_words``.
    """

    _: KW_ONLY
    incident_level: float | None = var(unit="dB", text="stated level of the incident wave", default=None)
    goodrich: Tensor | None = var("frequency", name="goodrich_{}", default=None, text="without sound, by Goodrich")
    choices: Mapping[str, Any] = field(default_factory=dict)
    notes: tuple[Note, ...] = ()
    level_check: LevelCheck | None = part(default=None)

    @property
    def level_check_words(self) -> str:
        """What the whole is compared with, or why it is not, which the choices say."""
        check = self.level_check
        if check is None:
            return str(self.choices.get("level_check", UNKNOWN))
        degrees = f" or {check.limit * DEGREES_PER_DB:.2g} degrees" if bool(check.liner.phase.isfinite().any()) else ""
        return f"off {check.known}, limit {check.limit:.2g} dB{degrees}"


def require_same_case(first: Any, other: Any, names: Sequence[str], remedy: str, *, where_stated: bool = False) -> None:
    """Refuse two records, planes or pressures, that state different things: ``names`` of attributes, and the case in
    the provenance. ``remedy``: last words of the message; ``where_stated``: what one does not state passes."""
    pairs = {name: (getattr(first, name), getattr(other, name)) for name in names}
    pairs["case"] = (first.provenance.get("case"), other.provenance.get("case"))
    for name, (mine, theirs) in pairs.items():
        if mine != theirs and not (where_stated and None in (mine, theirs)):
            raise ValueError(
                f"{first.name} and {other.name} are not one case: {name} is {mine!r} and {theirs!r}; {remedy}"
            )


def require_same_run(plane: Any, record: Any) -> None:
    """Refuse a pressure record that states another case, tone, level or flow than the plane."""
    require_same_case(plane, record, OF_ONE_RUN, "name the pressure record of the same run", where_stated=True)


def same_probes(first: Any, other: Any) -> bool:
    """Whether two records have probes of one shape at the same places."""
    return first.probe_shape == other.probe_shape and all(
        mine is theirs if mine is None or theirs is None else float((mine - theirs).abs().max()) <= SAME_PLACE
        for mine, theirs in ((first.x, other.x), (first.z, other.z))
    )


def require_same_probes(first: Any, other: Any) -> None:
    """Refuse files of one plane whose probes or stated case differ, by a ValueError that names what does."""
    if not same_probes(first, other):
        raise ValueError(f"{first.name} and {other.name} cannot be joined: their probes have other shapes or places")
    require_same_case(first, other, OF_ONE_PLANE, "restarts of one run state the same")


def planes_by_height(planes: Sequence[Any]) -> list[Any]:
    """The planes, lowest first; a ValueError for none, one without a height, two at one height, several cases."""
    if not planes:
        raise ValueError("no plane is given")
    for plane in planes:
        if plane.height is None:
            raise ValueError(f"{plane.name} states no height; set 'height' (m) in the file, or convert with --height")
    ordered = sorted(planes, key=lambda plane: plane.height)
    for before, plane in itertools.pairwise(ordered):
        if plane.height - before.height < SAME_PLACE:
            raise ValueError(f"{before.name} and {plane.name} are both at {1e3 * plane.height:g} mm; give one another")
        require_same_case(ordered[0], plane, STATED, "give the heights of one case")
    return ordered
