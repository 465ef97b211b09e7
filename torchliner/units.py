"""Units as they stand in files, to SI; phases to degrees."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from torchliner.names import did_you_mean

_NONE = (-math.inf, math.inf)
_UNITS = {  # by quantity: each unit and its factor to SI; what no measurement of this field exceeds, SI
    "velocity": ("m/s=1; mm/s=1e-3; cm/s=1e-2; km/s=1e3; ft/s=0.3048", (-1e6, 1e6)),
    "velocity squared": ("m2/s2=1", _NONE),
    "length": ("m=1; mm=1e-3; cm=1e-2; um=1e-6; in=0.0254; ft=0.3048", (-1e5, 1e5)),
    "area": ("m2=1; mm2=1e-6; cm2=1e-4", (0.0, 1e10)),
    "wavenumber": ("1/m=1; rad/m=1", _NONE),
    "time": ("s=1; ms=1e-3; us=1e-6; ns=1e-9; min=60; h=3600; d=86400", (-1e9, 1e9)),
    "frequency": ("Hz=1; 1/s=1; s-1=1; kHz=1e3", (0.0, 1e9)),
    "level": ("dB=1", (-1e3, 1e3)),
    "number": ("1=1; =1", _NONE),
    "impedance": ("rho c=1", (-1e6, 1e6)),
    "phase": ("deg=1; degree=1; degrees=1; °=1; rad=57.29577951308232", (-1e6, 1e6)),
    "density": ("kg/m3=1", (0.0, 1e5)),
    "temperature": ("K=1", (0.0, 1e4)),
    "pressure": ("Pa=1; kPa=1e3; hPa=100; mbar=100; bar=1e5; uPa=1e-6; MPa=1e6; atm=101325", (-1e12, 1e12)),
    "viscosity": ("Pa s=1; kg/(m s)=1; kg/m/s=1", (0.0, 1e3)),
}
FACTORS = {
    quantity: {unit: float(factor) for unit, factor in (each.rsplit("=", 1) for each in units.split("; "))}
    for quantity, (units, _) in _UNITS.items()
}
# Which quantity an SI unit is one of: "m" a length, "1" a number.
SI_QUANTITY = {unit: quantity for quantity, units in FACTORS.items() for unit, factor in units.items() if factor == 1}
# How else files spell units, without the s of a plural.
WORDS = {"meter": "m", "metre": "m", "second": "s", "sec": "s", "hertz": "Hz", "pascal": "Pa", "kelvin": "K"}


def si_factor(quantity: str, unit: str | None, name: str) -> float:
    """Factor to SI of a ``unit`` as found (None: there is none) of a quantity of ``FACTORS``, at ``name``; ValueError
    where there is no unit, or one that is not of this quantity."""
    known = FACTORS[quantity]
    listed = ", ".join(each for each in known if each)
    if unit is None:
        raise ValueError(f"{name} has no units attribute; set it to one of {listed}")
    # The micro sign has two code points, and data sets say more after a comma: "m/s, positive away from the wall".
    text = unit.replace("\u00b5", "u").replace("\u03bc", "u").split(",")[0].strip()
    plain = re.sub(r"[a-z]+", lambda word: WORDS.get(word[0].lower().rstrip("s"), word[0]), text, flags=re.IGNORECASE)
    plain = re.sub(r"[ .*]*\b([A-Za-z]+)(?:\^|\*\*)?-(\d)", r"/\1\2", plain)  # "m s^-1" is m/s
    plain = re.sub(r"\s*/\s*", "/", re.sub(r"(?<=[A-Za-z])1\b|\^", "", plain))
    if (found := known.get(text, known.get(plain))) is not None:
        return found
    near = did_you_mean(text, list(known))
    raise ValueError(f"{name} has units {unit!r}{near}; a {quantity} is needed in one of {listed}")


def require_plausible(values: Any, quantity: str, label: str, lines: Sequence[int] | None = None) -> None:
    """Refuse finite values (SI) that no measurement of a quantity has: a wrong unit, a mark of missing values, damage.
    ``lines``: of a file, one a value."""
    _, (low, high) = _UNITS[quantity]
    bad = np.isfinite(values) & ((values < low) | (values > high))
    if bad.any():
        worst = np.asarray(values)[bad].reshape(-1)[0]
        label = label if lines is None else f"{label}, line {lines[int(bad.argmax())]},"
        unit = next(iter(FACTORS[quantity]))
        raise ValueError(
            f"{label} holds {worst:g} {unit}, which is no {quantity} ({low:g} to {high:g} {unit}); "
            "check the unit, or mark values that are missing"
        )
