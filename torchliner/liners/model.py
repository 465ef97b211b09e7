"""What a liner is to the rest of the package: an impedance, and what a model may state besides."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol, Self

from torch import Tensor

from torchliner.checks import make_plain, plain_number, require_choice
from torchliner.fluid import Fluid
from torchliner.liners.parameters import Number, arguments_of, checked, numbers_of


class Liner(Protocol):
    """What may be passed as a liner: anything that gives an impedance."""

    def impedance(self, frequency: Any, speed: Any, /) -> Any:
        """Z, normalised by rho c, of the broadcast shape of frequency (Hz) and |v| (m/s)."""
        ...


class LinerModel:
    """Base class of liner models. ``impedance`` is all that a model must define.

    The rest is what the package asks of a liner; each default says that the model does not state it. A frozen dataclass
    whose fields have the types of ``parameters.py`` has the checks of their values, ``numbers``, ``with_numbers``,
    ``describe`` and the keys of its liner files from them.

    Attributes:
        model: its name in liner files, a key of ``names.LINER_MODELS``.
        file_keys: keys of its liner files, for pydantic; None: its fields.
        groups: names that stand for several of ``numbers``.
        name: for labels.  cell_pitch: L_c, m, for averages over cells.  fluid: gas, compared with that of the data.
        files: names of the files it was read from; of presets and changed copies none.
    """

    model: ClassVar[str] = ""
    file_keys: ClassVar[Mapping[str, Any] | None] = None
    groups: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    name: str = ""
    cell_pitch: float | None = None
    fluid: Fluid | None = None
    files: tuple[str, ...] = ()

    def __post_init__(self) -> None:
        if not self.name:
            object.__setattr__(self, "name", self.model)
        make_plain(self, tensors=True)
        for name, value in checked(type(self), vars(self), f"liner {self.name!r}").items():
            object.__setattr__(self, name, value)

    @classmethod
    def from_file(cls, keys: Mapping[str, Any], folder: Path) -> Self:
        """The liner from the keys of a file, beside which others are found."""
        return cls(**keys)

    def impedance(self, frequency: Any, speed: Any = 0.0) -> Any:
        """Normalised impedance, complex, time dependence e^(j omega t).

        Args:
            frequency: Hz, above 0, any shape.
            speed: |v| m/s, at least 0, any shape that broadcasts with ``frequency``.
        """
        raise NotImplementedError(f"{type(self).__name__} defines no impedance(frequency, speed)")

    @property
    def frequency_range(self) -> tuple[float, float] | None:
        """Lowest and highest frequency that ``impedance`` takes, Hz; None without limits."""
        return None

    @property
    def speed_max(self) -> float | None:
        """Highest |v| that ``impedance`` takes, m/s; None without a limit."""
        return None

    @property
    def speed_kinks(self) -> tuple[float, ...]:
        """|v| (m/s) at which ``impedance`` has a kink, as a table has at each of its speeds."""
        return ()

    @property
    def surface_porosity(self) -> float | None:
        """Open area over the whole surface, for eqs (2.7) and (A3)."""
        return None

    @property
    def hole_diameter(self) -> float | None:
        """Of the holes that face the flow, m, for eqs (2.7) and (A2)."""
        return None

    @property
    def flow_resistance(self) -> float:
        """Resistance that the model itself adds for grazing flow, normalised; 0 without."""
        return 0.0

    @property
    def lacks_mach(self) -> bool:
        """Whether its law depends on the Mach number of the flow, and the liner states none."""
        return False

    def in_flow(self, mach: float | None) -> LinerModel:
        """The liner in the flow of the data, whose bulk Mach number may be unknown; itself where its law takes none.

        Raises:
            ValueError: the liner states another Mach number.
        """
        return self

    def numbers(self) -> dict[str, Number]:
        """The real parameters that sensitivities, tolerances and fits may vary, by name."""
        return numbers_of(type(self), vars(self))

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """A copy with other ``numbers``: by name, SI; floats, or 0-d float64 tensors, through which derivatives pass if
        ``impedance`` computes with torch."""
        return self.replace(**values)

    def replace(self, **changes: Any) -> Self:
        """A copy with some arguments changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def describe(self) -> dict[str, Any]:
        """The model and all its arguments as plain values, for provenance and liner files."""
        kind: Any = type(self)
        stated = {name: plain(getattr(self, name)) for name in arguments_of(kind)}
        return {"model": self.model or type(self).__name__, **stated}


def plain(value: Any) -> Any:
    """An argument of a model as a plain value."""
    if isinstance(value, Tensor):
        value = value.detach().item()
    if isinstance(value, Fluid):
        return {name: plain(each) for name, each in vars(value).items()}
    if isinstance(value, complex):
        return [value.real, value.imag]
    if isinstance(value, tuple):
        return [each.describe() if hasattr(each, "describe") else each for each in value]
    return value


STATED = ("impedance", "describe", "cell_pitch", "fluid", "frequency_range", "speed_max", "surface_porosity")


def as_liner(liner: Any) -> LinerModel:
    """The liner itself, or any object with ``impedance(frequency, speed)`` as a ``LinerModel``.

    Of such an object are taken, where it has them, the members of ``STATED`` and ``orifice_diameter`` (m); for the rest
    the defaults hold.

    Raises:
        TypeError: no ``impedance``.
    """
    if isinstance(liner, LinerModel):
        return liner
    if not hasattr(liner, "impedance"):
        raise TypeError(
            f"liner is {liner!r}, without impedance(frequency, speed); presets and files are read by load_liner"
        )
    members = {name: getattr(liner, name) for name in STATED if hasattr(liner, name)}
    if hasattr(liner, "orifice_diameter"):
        members["hole_diameter"] = plain_number(liner.orifice_diameter)
    made: LinerModel = with_members(type(liner).__name__, members, LinerModel)()
    return made


def with_members(name: str, members: Mapping[str, Any], *bases: type) -> type:
    """A class with these values, and functions that take no ``self``."""
    return type(name, bases, {key: staticmethod(each) if callable(each) else each for key, each in members.items()})


def named_numbers(liner: LinerModel, names: Iterable[str] | None = None) -> dict[str, Number]:
    """The numbers of these names, groups as their parts; all of them for None.

    Raises:
        TypeError: the model states no numbers.
        ValueError: an unknown name (the nearest is given), or one that is named twice.
    """
    numbers = liner.numbers()
    if not numbers:
        raise TypeError(
            f"liner is {type(liner).__name__}, whose numbers() names no parameter to vary; a model of your own states "
            "them by the types of its fields (CONTRIBUTING.md)"
        )
    found: dict[str, Number] = {}
    for name in numbers if names is None else names:
        if name not in liner.groups:
            require_choice("parameter", name, [*numbers, *liner.groups])
        for each in liner.groups.get(name, (name,)):
            if each in found:
                raise ValueError(f"parameter {each} is named twice")
            found[each] = numbers[each]
    return found
