"""Units as they stand in files, to SI; phases to degrees."""

import math
import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from torchliner.names import did_you_mean

_NONE = (-math.inf, math.inf)
_UNITS = {  # by quantity: each unit and its factor to SI; what no measurement of this field exceeds, SI
    "velocity": ("m/s=1; m s-1=1; m s^-1=1; m.s-1=1; mm/s=1e-3; cm/s=1e-2; km/s=1e3; ft/s=0.3048", (-1e6, 1e6)),
    "velocity squared": ("m2/s2=1; m2 s-2=1", _NONE),
    "length": ("m=1; mm=1e-3; cm=1e-2; um=1e-6; in=0.0254; ft=0.3048", (-1e5, 1e5)),
    "area": ("m2=1; mm2=1e-6; cm2=1e-4", (0.0, 1e10)),
    "wavenumber": ("1/m=1; rad/m=1", _NONE),
    "time": ("s=1; ms=1e-3; us=1e-6; ns=1e-9; min=60; h=3600; d=86400", (-1e9, 1e9)),
    "frequency": ("Hz=1; 1/s=1; s-1=1; kHz=1e3", (0.0, 1e9)),
    "level": ("dB=1", (-1e3, 1e3)),
    "number": ("1=1; =1", _NONE),
    "impedance": ("rho c=1", (-1e6, 1e6)),
    "phase": ("deg=1; degree=1; degrees=1; °=1; rad=57.29577951308232", (-1e6, 1e6)),
    "density": ("kg/m3=1; kg m-3=1", (0.0, 1e5)),
    "temperature": ("K=1", (0.0, 1e4)),
    "pressure": (
        "Pa=1; kPa=1e3; hPa=100; mbar=100; bar=1e5; uPa=1e-6; MPa=1e6; psi=6894.757293168361; atm=101325",
        (-1e12, 1e12),
    ),
    "viscosity": ("Pa s=1; kg/(m s)=1; kg/m/s=1", (0.0, 1e3)),
}
FACTORS = {
    quantity: {unit: float(factor) for unit, factor in (each.rsplit("=", 1) for each in units.split("; "))}
    for quantity, (units, _) in _UNITS.items()
}
# Which quantity an SI unit is one of: "m" a length, "1" a number.
SI_QUANTITY = {unit: quantity for quantity, units in FACTORS.items() for unit, factor in units.items() if factor == 1}
# How else files spell units: words, as netCDF has them, then powers.
_PREFIXES = {"milli": "m", "centi": "c", "kilo": "k", "micro": "u", "nano": "n", "": ""}
_NAMES = {"met(?:er|re)s?": "m", "sec(?:ond)?s?": "s", "hertz": "Hz", "pascals?": "Pa", "decibels?": "dB"}
WORDS = {rf"\b{a}{b}\b": short + unit for a, short in _PREFIXES.items() for b, unit in _NAMES.items()}
WORDS |= {r"\bmsecs?\b": "ms", r"\bdays?\b": "d", r"\bhours?\b|\bhrs?\b": "h", r"\bminutes?\b": "min"}
WORDS |= {r"\bkelvin\b": "K", r"\s*\bper\b\s*": "/"}
POWERS = dict(zip("\u207b\u00b9\u00b2\u00b3\u00b7\u22c5", "-123  ", strict=True)) | {"**": "^"}
_TEXT = re.compile(r"(?:±|\+/?-)?\s*(\d+\.?\d*(?:[eE][+-]?\d+)?|\.\d+(?:[eE][+-]?\d+)?)\s*(.*)")


def si_factor(quantity: str, unit: str | None, name: str) -> float:
    """Factor to SI of a ``unit`` as found (None: there is none) of a quantity of ``FACTORS``, at ``name``; ValueError
    where there is no unit, or one that is not of this quantity."""
    known = FACTORS[quantity]
    listed = ", ".join(each for each in known if each)
    if unit is None:
        raise ValueError(f"{name} has no units attribute; set it to one of {listed}")
    # The micro sign has two code points; files of either kind mean u.
    text = unit.strip().replace("\u00b5", "u").replace("\u03bc", "u")
    # Data sets often say more after a comma: "m/s, wall-normal, positive away from the wall".
    for candidate in (text, text.split(",")[0].strip(), canonical_unit(text)):
        if candidate in known:
            return known[candidate]
    near = did_you_mean(text, list(known))
    raise ValueError(f"{name} has units {unit!r}{near}; a {quantity} is needed in one of {listed}")


def canonical_unit(text: str) -> str:
    """A unit as ``FACTORS`` spells it, of what means the same: "meters", "m s**-1", "m/sec".

    >>> canonical_unit("metre second-1"), canonical_unit("kg m^-3"), canonical_unit("m/sec")
    ('m/s', 'kg/m3', 'm/s')
    """
    for spelled, plain in POWERS.items():
        text = text.replace(spelled, plain)
    for word, unit in WORDS.items():
        text = re.sub(word, unit, text, flags=re.IGNORECASE)
    # "m s^-1" is m/s: what has a power below 0 is divided by, a power of 1 is none.
    text = re.sub(r"[ .*]*\b([A-Za-z]+)\^?-(\d)", lambda found: "/" + found[1] + found[2], text)
    text = re.sub(r"(?<=[A-Za-z])\^?1\b", "", text).replace("^", "")
    return re.sub(r"^/", "1/", re.sub(r"\s*/\s*", "/", text.strip()))


def require_plausible(values: Any, quantity: str, label: str, lines: Sequence[int] | None = None) -> None:
    """Refuse finite values (SI) that are none of a quantity: a wrong unit, a mark of missing values, damage; nan and
    inf are the affair of the reader.

    Args:
        values: array.  quantity: a key of ``FACTORS``.  label: where they stand.  lines: of a file, one a value.
    Raises:
        ValueError: a value that no measurement of this field has.
    """
    _, (low, high) = _UNITS.get(quantity, ("", _NONE))
    bad = np.isfinite(values) & ((values < low) | (values > high))
    if bad.any():
        worst = np.asarray(values)[bad].reshape(-1)[0]
        label = label if lines is None else f"{label}, line {lines[int(bad.argmax())]},"
        unit = next(iter(FACTORS[quantity]))
        raise ValueError(
            f"{label} holds {worst:g} {unit}, which is no {quantity} ({low:g} to {high:g} {unit}); "
            "check the unit, or mark values that are missing"
        )


def parse_tolerance(text: Any, name: str, quantity: str, value: float) -> float:
    """Half-width of a tolerance, SI, from text such as "0.02 mm", "+-0.02 mm", "2 %" (of ``value``), or a plain number
    of what has no unit.

    Raises:
        ValueError: no unit or a wrong one, not above 0, or per cent of 0.
    """
    found = _TEXT.fullmatch(str(text).strip())
    number, unit = (float(found[1]), found[2].strip()) if found else (0.0, "")
    if found and unit != "%":
        number *= si_factor(quantity, unit, f"tolerance of {name} {text!r}")
    width = number * abs(value) / 100 if unit == "%" else number
    if not 0 < width < math.inf:
        raise ValueError(f"tolerance of {name} is {text!r}; write a half-width above 0 and its unit, or per cent")
    return width
