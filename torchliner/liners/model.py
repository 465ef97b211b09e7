"""What a liner is to the rest of the package: an impedance, and what a model may state besides."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Protocol, Self

from torch import Tensor

from torchliner.checks import plain_number, require_choice
from torchliner.fluid import Fluid
from torchliner.units import FACTORS

QUANTITIES = {next(iter(units)): quantity for quantity, units in FACTORS.items()}  # by SI unit


class Liner(Protocol):
    """What may be passed as a liner: anything that gives an impedance."""

    def impedance(self, frequency: Any, speed: Any, /) -> Any:
        """Z, normalised by rho c, of the broadcast shape of frequency (Hz) and |v| (m/s)."""
        ...


@dataclass(frozen=True)
class Number:
    """A real parameter of a model that may be varied.

    Args:
        value: SI.  unit: SI, "1" if it has none.
        low, high: what makes sense: above ``low``, at most ``high``.
        low_included: whether ``low`` itself makes sense.
    """

    value: float
    unit: str = "1"
    low: float = 0.0
    high: float = math.inf
    low_included: bool = False

    @property
    def quantity(self) -> str:
        """Kind of its units, a key of ``units.FACTORS``."""
        return QUANTITIES.get(self.unit, "number")


class LinerModel:
    """Base class of liner models. ``impedance`` is all that a model must define.

    The rest is what the package asks of a liner; each default says that the model does not state
    it. As a frozen dataclass of its parameters a model has ``replace``, ``describe`` and
    ``with_numbers`` without further code.
    """

    model: ClassVar[str] = ""
    """Name of the model in liner files, a key of ``names.LINER_MODELS``."""
    groups: ClassVar[Mapping[str, tuple[str, ...]]] = {}
    """Names that stand for several of ``numbers``."""
    cell_pitch: float | None = None
    """L_c, m, for averages over cells."""
    fluid: Fluid | None = None
    """Gas, compared with that of the data."""
    files: tuple[str, ...] = ()
    """Names of the files it was read from; of presets and changed copies none."""

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
    def flow_resistance(self) -> float:
        """Resistance that the model itself adds for grazing flow, normalised; 0 without."""
        return 0.0

    @property
    def hole_diameter(self) -> float | None:
        """Of the holes that face the flow, m, for eqs (2.7) and (A2)."""
        return None

    @property
    def lacks_mach(self) -> bool:
        """Whether its law depends on the Mach number of the flow, and the liner states none."""
        return False

    def in_flow(self, mach: float | None) -> LinerModel:
        """The liner in the flow of the data; itself where its law takes none.

        Args:
            mach: bulk Mach number that the data state; None where they state none.
        Raises:
            ValueError: the liner states another one.
        """
        return self

    def numbers(self) -> dict[str, Number]:
        """The real parameters that sensitivities, tolerances and fits may vary, by name."""
        return {}

    def with_numbers(self, values: Mapping[str, Any]) -> Self:
        """A copy with other ``numbers``.

        Args:
            values: by name, SI: floats, or 0-d float64 tensors, through which derivatives pass if
                ``impedance`` computes with torch.
        """
        return self.replace(**values)

    def replace(self, **changes: Any) -> Self:
        """A copy with some arguments changed."""
        return dataclasses.replace(self, **changes)  # type: ignore[type-var]

    def describe(self) -> dict[str, Any]:
        """The model and all its arguments as plain values, for provenance and liner files."""
        stated: dict[str, Any] = plain_fields(self) if dataclasses.is_dataclass(self) else {}
        return {"model": self.model or type(self).__name__, **stated}

    def facts(self) -> dict[str, Any]:
        """What ``torchliner liner`` prints."""
        return self.describe()


def plain_fields(record: Any) -> dict[str, Any]:
    """Fields of a dataclass as plain values."""
    plain: dict[str, Any] = {}
    for name in (each.name for each in dataclasses.fields(record)):
        value = getattr(record, name)
        if isinstance(value, Tensor):
            value = value.detach().item()
        if isinstance(value, Fluid):
            value = dataclasses.asdict(value)
        if isinstance(value, complex):
            value = [value.real, value.imag]
        if isinstance(value, tuple):
            value = [each.describe() if hasattr(each, "describe") else each for each in value]
        plain[name] = value
    return plain


STATED = ("impedance", "describe", "cell_pitch", "fluid", "frequency_range",
          "speed_max", "surface_porosity")  # fmt: skip


def as_liner(liner: Any) -> LinerModel:
    """The liner itself, or any object with ``impedance(frequency, speed)`` as a ``LinerModel``.

    Of such an object are taken, where it has them, the members of ``STATED`` and
    ``orifice_diameter`` (m); for the rest the defaults hold.

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
    bound = {name: staticmethod(m) if callable(m) else m for name, m in members.items()}
    made: LinerModel = type(type(liner).__name__, (LinerModel,), bound)()
    return made


def named_numbers(liner: LinerModel, names: Iterable[str] | None = None) -> dict[str, Number]:
    """The numbers of these names, groups as their parts; all of them for None.

    Raises:
        TypeError: the model states no numbers.
        ValueError: an unknown name (the nearest is given), or one that is named twice.
    """
    numbers = liner.numbers()
    if not numbers:
        raise TypeError(
            f"liner is {type(liner).__name__}, whose numbers() names no parameter to vary; an "
            "SDoFLiner has them, a table has none, and a model of your own states them by "
            "deriving from LinerModel and defining numbers()"
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
