"""What a liner is to the rest of the package: an impedance, and parameters that are declared once, with unit and range.

From the type of a field (``Length``, ``Share``; ``Annotated[Any, Number(unit="kg/m2")]`` is a new one) follow the check
of its value, the key of a liner file, and what sensitivities, tolerances and fits may vary. A value is a number, or a
0-d float64 tensor through which derivatives pass.
"""

from __future__ import annotations

import dataclasses
import inspect
import math
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from typing import Annotated, Any, ClassVar, Protocol, Self, get_type_hints

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import make_plain, one_number, plain_number, require_choice
from torchliner.conversions import reflection_from_impedance
from torchliner.fluid import Fluid

SLIPS = {"1": " (5 % is 0.05)", "m": " (1 mm is 0.001 m)"}  # by unit, where a value is too large
STATED = "impedance describe cell_pitch fluid frequency_range speed_max surface_porosity hole_diameter".split()


@dataclass(frozen=True)
class Number:
    """A real parameter of a model, SI, or, without a value, what is declared of it: above ``low`` (or at it, if
    ``low_included``), at most ``high``; ``varied``: whether it is one of a model's ``numbers``."""

    value: float = math.nan
    unit: str = "1"
    low: float = 0.0
    high: float = math.inf
    low_included: bool = False
    varied: bool = True

    def at(self, value: Any) -> Number:
        """Another value."""
        return dataclasses.replace(self, value=plain_number(value))

    def require(self, name: str) -> None:
        """Raise a ValueError with name, value, unit and range unless the value is finite and within the range."""
        above = self.value >= self.low if self.low_included else self.value > self.low
        if not (above and math.isfinite(self.value) and self.value <= self.high):
            unit = "" if self.unit == "1" else f" {self.unit}"
            limits = f"{'at least' if self.low_included else 'above'} {self.low:g}{unit}"
            limits += f" and at most {self.high:g}{unit}" if self.high < math.inf else ""
            slip = SLIPS.get(self.unit, "") if self.value > self.high else ""
            raise ValueError(f"{name} is {self.value:g}{unit}; it is {limits}{slip}")


Length = Annotated[Any, Number(unit="m", high=0.1)]  # of plates; more are millimetres given as metres
Depth = Annotated[Any, Number(unit="m", high=10.0)]  # of cavities, likewise
Share = Annotated[Any, Number(high=1.0)]
ShareFrom0 = Annotated[Any, Number(high=1.0, low_included=True)]
Factor = Annotated[Any, Number()]
FactorFrom0 = Annotated[Any, Number(low_included=True)]
Coefficient = Annotated[Any, Number(low=-math.inf)]
Mach = ShareFrom0
Pitch = Annotated[float | None, Number(unit="m", varied=False)]


@cache
def arguments_of(declared: type) -> dict[str, tuple[Number | None, Any]]:
    """What a class declares of each argument, and its default, by name; those that only keywords give come last."""
    marks = {
        name: next((each for each in getattr(hint, "__metadata__", ()) if isinstance(each, Number)), None)
        for name, hint in get_type_hints(declared, include_extras=True).items()
    }
    return {name: (marks.get(name), each.default) for name, each in inspect.signature(declared).parameters.items()}


class Declared:
    """Base of frozen dataclasses whose fields have these types; TypeError for a parameter that is no number, ValueError
    for one outside its range."""

    def __post_init__(self) -> None:
        make_plain(self, tensors=True)
        for name, mark, value in self._parameters():
            where = f"{self.label}: {name}"
            number = one_number(where, value.detach() if isinstance(value, Tensor) else value)
            mark.at(number).require(where)
            if not isinstance(value, Tensor):
                self.settle(**{name: number})

    @property
    def label(self) -> str:
        """For messages."""
        return f"layer {getattr(self, 'kind', '')!r}"

    def settle(self, **values: Any) -> None:
        """Set what follows from the arguments."""
        for name, value in values.items():
            object.__setattr__(self, name, value)

    def _parameters(self) -> Iterator[tuple[str, Number, Any]]:
        """With declaration and value; those left at a default of None are passed over."""
        own: Any = type(self)
        for name, (mark, default) in arguments_of(own).items():
            value = getattr(self, name)
            if mark is not None and (value is not None or default is not None):
                yield name, mark, value

    def numbers(self) -> dict[str, Number]:
        """The real parameters that sensitivities, tolerances and fits may vary, by name."""
        return {name: mark.at(value) for name, mark, value in self._parameters() if mark.varied}

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """A copy with other ``numbers``: by name, SI; floats, or 0-d float64 tensors with derivatives."""
        return self.replace(**values)

    def replace(self, **changes: Any) -> Self:
        """A copy with some arguments changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def describe(self) -> dict[str, Any]:
        """The ``model`` of a liner or the ``kind`` of a layer, and all arguments as plain values, for provenance and
        liner files."""
        own: Any = type(self)
        kinds = {key: getattr(own, key) or own.__name__ for key in ("model", "kind") if hasattr(own, key)}
        return {**kinds, **{name: plain(getattr(self, name)) for name in arguments_of(own)}}


def plain(value: Any) -> Any:
    """An argument of a model as a plain value."""
    if isinstance(value, Tensor):
        value = (torch.view_as_real(value) if value.is_complex() else value).tolist()
    if isinstance(value, Fluid):
        return {name: plain(each) for name, each in vars(value).items()}
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, tuple):
        return [each.describe() if hasattr(each, "describe") else each for each in value]
    return value


class Liner(Protocol):
    """What may be passed as a liner: anything that gives an impedance."""

    def impedance(self, frequency: Any, speed: Any, /) -> Any:
        """Z, normalised by rho c, of the broadcast shape of frequency (Hz) and |v| (m/s)."""
        ...


class LinerModel(Declared):
    """Base class of liner models, frozen dataclasses. ``impedance`` is all that a model must define; each default says
    that the model does not state it. What follows from the arguments is set by ``settle``.

    Attributes:
        model: its name in liner files, a key of ``names.LINER_MODELS``.
        groups: names that stand for several of ``numbers``.
        name: for labels.  cell_pitch: L_c, m, for averages over cells.  fluid: gas, compared with that of the data.
        files: names of the files it was read from; of presets and changed copies none.
        frequency_range, speed_max: what ``impedance`` takes, Hz and m/s; None without limits.
        speed_kinks: |v| (m/s) at which ``impedance`` has a kink, as a table has at each of its speeds.
        surface_porosity, hole_diameter: open area over the whole surface; of the holes, m: for eqs (2.7), (A2), (A3).
        flow_resistance: what the model itself adds for grazing flow, normalised.
        lacks_mach: whether its law depends on the Mach number of the flow, and the liner states none.
    """

    model: ClassVar[str] = ""
    groups: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    name: str = ""
    cell_pitch: float | None = None
    fluid: Fluid | None = None
    files: tuple[str, ...] = ()
    frequency_range: tuple[float, float] | None = None
    speed_max: float | None = None
    speed_kinks: tuple[float, ...] = ()
    surface_porosity: float | None = None
    hole_diameter: float | None = None
    flow_resistance: float = 0.0
    lacks_mach: bool = False

    def __post_init__(self) -> None:
        self.settle(name=self.name or self.model)
        super().__post_init__()

    @property
    def label(self) -> str:
        """For messages."""
        return f"liner {self.name!r}"

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Any:
        """Normalised impedance, complex, e^(j omega t), of the broadcast shape of frequency (Hz) and |v| (m/s)."""
        raise NotImplementedError(f"{type(self).__name__} defines no impedance(frequency, speed)")

    def in_flow(self, mach: float | None) -> LinerModel:
        """The liner in the flow of the data; itself where its law takes no Mach number, ValueError where it states
        another."""
        return self


def as_liner(liner: Any) -> LinerModel:
    """The liner itself, or any object with ``impedance(frequency, speed)``, and perhaps members of ``STATED``, as a
    ``LinerModel``; TypeError without ``impedance``."""
    if isinstance(liner, LinerModel):
        return liner
    if not hasattr(liner, "impedance"):
        raise TypeError(f"liner is {liner!r}, without impedance(frequency, speed); load_liner reads presets and files")
    made: LinerModel = type(type(liner).__name__, (LinerModel,), {})()
    made.settle(**{name: getattr(liner, name) for name in STATED if hasattr(liner, name)})
    return made


def named_numbers(liner: LinerModel, names: Iterable[str] | None = None) -> dict[str, Number]:
    """The numbers of these names, groups as their parts; all of them for None. TypeError where the model states none,
    ValueError for an unknown name (the nearest is given)."""
    if not (numbers := liner.numbers()):
        what = f"{type(liner).__name__}, whose numbers() names no parameter to vary"
        raise TypeError(f"liner is {what}; a model states them by the types of its fields (CONTRIBUTING.md)")
    found: dict[str, Number] = {}
    for name in numbers if names is None else names:
        if name not in liner.groups:
            require_choice("parameter", name, [*numbers, *liner.groups])
        found |= {each: numbers[each] for each in liner.groups.get(name, (name,))}
    return found


def reflection_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """R = (Z - 1)/(Z + 1), complex128, of the broadcast shape of frequency (Hz) and |v| (m/s)."""
    return reflection_from_impedance(impedance_of(liner, frequency, speed))


def impedance_of(liner: Liner, frequency: Tensor, speed: Tensor, name: str = "") -> Tensor:
    """``liner.impedance`` of any user's object, as complex128 of the broadcast shape; ``name`` of it in messages.
    TypeError for no numbers, ValueError for another shape, nan, inf or -1, for which R has no value."""
    name = name or f"{type(liner).__name__}.impedance(frequency, speed)"
    found = liner.impedance(frequency, speed)
    if not isinstance(found, Tensor):  # torch takes Python's own numbers in its default precision
        array = np.asarray(found)
        if array.dtype.kind not in "fiuc":
            raise TypeError(f"{name} gave {type(found).__name__}; numbers are needed, normalised by rho c")
        found = torch.as_tensor(array.astype(np.complex128))
    found = found.to(torch.complex128)
    if not bool(torch.isfinite(found.detach().abs()).all()) or bool((found == -1).any()):
        band = (
            f"between {float(frequency.min()):g} and {float(frequency.max()):g} Hz and up to {float(speed.max()):g} m/s"
        )
        raise ValueError(f"{name} gave nan, inf or -1 {band}, where R = (Z - 1)/(Z + 1) has no value")
    shape = np.broadcast_shapes(frequency.shape, speed.shape)
    try:
        broadcast: Tensor = found.broadcast_to(shape)
        return broadcast
    except RuntimeError as error:
        raise ValueError(f"{name} gave shape {tuple(found.shape)}; {tuple(shape)} is needed") from error
