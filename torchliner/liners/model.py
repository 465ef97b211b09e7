"""What a liner is to the rest of the package: an impedance, its checked values, and what a model may state besides."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

import numpy as np
import torch
from torch import Tensor

from torchliner.checks import plain_number, require_choice
from torchliner.conversions import reflection_from_impedance
from torchliner.fluid import Fluid
from torchliner.liners.parameters import Declared, Number


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
        file_keys: keys of its liner files, none of which is needed; None: its fields.
        groups: names that stand for several of ``numbers``.
        name: for labels.  cell_pitch: L_c, m, for averages over cells.  fluid: gas, compared with that of the data.
        files: names of the files it was read from; of presets and changed copies none.
        frequency_range, speed_max: what ``impedance`` takes, Hz and m/s; None without limits.
        speed_kinks: |v| (m/s) at which ``impedance`` has a kink, as a table has at each of its speeds.
        surface_porosity: open area over the whole surface, for eqs (2.7) and (A3).
        hole_diameter: of the holes that face the flow, m, for eqs (2.7) and (A2).
        flow_resistance: what the model itself adds for grazing flow, normalised.
        lacks_mach: whether its law depends on the Mach number of the flow, and the liner states none.
    """

    model: ClassVar[str] = ""
    file_keys: ClassVar[tuple[str, ...] | None] = None
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

    @classmethod
    def from_file(cls, keys: Mapping[str, Any], folder: Path) -> Self:
        """The liner from the keys of a file, beside which others are found."""
        return cls(**keys)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Any:
        """Normalised impedance, complex, e^(j omega t), of the broadcast shape of frequency (Hz) and |v| (m/s)."""
        raise NotImplementedError(f"{type(self).__name__} defines no impedance(frequency, speed)")

    def in_flow(self, mach: float | None) -> LinerModel:
        """The liner in the flow of the data; itself where its law takes no Mach number, ValueError where it states
        another."""
        return self

    def describe(self) -> dict[str, Any]:
        """The model and all its arguments as plain values, for provenance and liner files."""
        return {"model": self.model or type(self).__name__, **super().describe()}


STATED = ("impedance", "describe", "cell_pitch", "fluid", "frequency_range", "speed_max", "surface_porosity")


def as_liner(liner: Any) -> LinerModel:
    """The liner itself, or any object with ``impedance(frequency, speed)``, and perhaps members of ``STATED`` and
    ``orifice_diameter`` (m), as a ``LinerModel``; TypeError without ``impedance``."""
    if isinstance(liner, LinerModel):
        return liner
    if not hasattr(liner, "impedance"):
        raise TypeError(f"liner is {liner!r}, without impedance(frequency, speed); load_liner reads presets and files")
    made: LinerModel = type(type(liner).__name__, (LinerModel,), {})()
    made.settle(**{name: getattr(liner, name) for name in STATED if hasattr(liner, name)})
    if hasattr(liner, "orifice_diameter"):
        made.settle(hole_diameter=plain_number(liner.orifice_diameter))
    return made


def named_numbers(liner: LinerModel, names: Iterable[str] | None = None) -> dict[str, Number]:
    """The numbers of these names, groups as their parts; all of them for None.

    Raises:
        TypeError: the model states no numbers.
        ValueError: an unknown name (the nearest is given), or one that is named twice.
    """
    numbers = liner.numbers()
    if not numbers:
        what = f"{type(liner).__name__}, whose numbers() names no parameter to vary"
        raise TypeError(f"liner is {what}; your own model states them by the types of its fields (CONTRIBUTING.md)")
    found: dict[str, Number] = {}
    for name in numbers if names is None else names:
        if name not in liner.groups:
            require_choice("parameter", name, [*numbers, *liner.groups])
        for each in liner.groups.get(name, (name,)):
            if each in found:
                raise ValueError(f"parameter {each} is named twice")
            found[each] = numbers[each]
    return found


def reflection_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """R = (Z - 1)/(Z + 1), complex128, of the broadcast shape of frequency (Hz) and |v| (m/s)."""
    return reflection_from_impedance(impedance_of(liner, frequency, speed))


def impedance_of(liner: Liner, frequency: Tensor, speed: Tensor) -> Tensor:
    """``liner.impedance`` of any user's object, as ``checked_impedance``."""
    name = f"{type(liner).__name__}.impedance(frequency, speed)"
    return checked_impedance(liner.impedance(frequency, speed), frequency, speed, name)


def checked_impedance(impedance: Any, frequency: Tensor, speed: Tensor, name: str) -> Tensor:
    """What a user's function ``name`` gave, as complex128 of the broadcast shape.

    Raises:
        TypeError: None, text.
        ValueError: another shape, nan, inf or -1, for which R has no value.
    """
    found = complex_tensor(impedance, name)
    if not bool(torch.isfinite(found.detach().abs()).all()) or bool((found == -1).any()):
        raise ValueError(
            f"{name} gave nan, inf or -1 between {float(frequency.min()):g} and {float(frequency.max()):g} Hz and up "
            f"to {float(speed.max()):g} m/s; R = (Z - 1)/(Z + 1) has no value there"
        )
    shape = np.broadcast_shapes(frequency.shape, speed.shape)
    try:
        return found.broadcast_to(shape)
    except RuntimeError as error:
        raise ValueError(
            f"{name} gave shape {tuple(found.shape)} for frequency {tuple(frequency.shape)} and speed "
            f"{tuple(speed.shape)}; {tuple(shape)} is needed"
        ) from error


def complex_tensor(impedance: Any, name: str) -> Tensor:
    """Tensor, array, list or number as complex128; TypeError for None and text, with the ``name`` that gave it."""
    if isinstance(impedance, Tensor):
        return impedance.to(torch.complex128)
    array = np.asarray(impedance)  # torch takes Python's own numbers in its default precision
    if array.dtype.kind not in "fiuc":
        raise TypeError(
            f"{name} gave {type(impedance).__name__} of {array.dtype}; numbers are needed, normalised by rho c"
        )
    return torch.as_tensor(array.astype(np.complex128))
