"""Poles and residues as JSON, or as the coefficient lists that solvers in the time domain take."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from torch import Tensor

from torchliner.io.whole_file import printable, written_whole
from torchliner.liners.multipole import Multipole
from torchliner.names import __version__

SCHEMA = "torchliner multipole 1"
REAL = 1e-8  # relative: an imaginary part below it is rounding
HEAD = """\
// {title}
// torchliner {version}; fitted from {low:g} to {high:g} Hz, R within {error:.2g}; stable, |R| <= 1 at every frequency
// Z = p/(rho c v) and R = (Z - 1)/(Z + 1), v into the wall, s = j omega with exp(+j omega t); in 1/s:
// constant + sum A/(s + lambda) + sum 1/2 [(B + jC)/(s + alpha + j beta) + (B - jC)/(s + alpha - j beta)]
"""


def coefficients_of(poles: Tensor, residues: Tensor) -> dict[str, list[list[float]]]:
    """Real poles as (lambda, A), conjugate pairs as (alpha, beta, B, C), all in 1/s; see ``HEAD``."""
    real, pairs = [], []
    for p, r in zip(poles.tolist(), residues.tolist(), strict=True):
        if abs(p.imag) <= REAL * abs(p):
            real.append([-p.real, r.real])
        elif p.imag > 0:
            pairs.append([-p.real, p.imag, 2 * r.real, -2 * r.imag])
    return {"real_poles": real, "complex_poles": pairs}


def plain_multipole(model: Multipole) -> dict[str, Any]:
    """What is written as JSON."""
    return {
        "schema": SCHEMA,
        "version": __version__,
        "convention": "Z = p/(rho c v), R = (Z - 1)/(Z + 1), exp(+j omega t), v into the wall, 1/s",
        "band": list(model.band),
        "error": model.error,
        "correction": model.correction,
        "reflection": {"constant": 1.0, **coefficients_of(model.poles, model.residues)},
        "admittance": {"constant": 0.0, **coefficients_of(*model.admittance())},
        "about": model.about,
    }


def write_multipole(model: Multipole, path: str | Path) -> None:
    """Write one file: ``.json``, or ``.txt`` with the lists of R and of the admittance as dictionaries of OpenFOAM.

    Raises:
        ValueError, OSError: as ``written_whole``.
    """
    plain = plain_multipole(model)
    with written_whole(path, ".json", ".txt") as temporary:
        if Path(path).suffix.lower() == ".json":
            temporary.write_text(json.dumps(plain, indent=1), encoding="utf-8")
            return
        title = printable(str(model.about.get("source", ""))) or "impedance as poles and residues"
        low, high = model.band
        text = HEAD.format(title=title, version=__version__, low=low, high=high, error=model.error)
        parts = [_dictionary(name, plain[name]) for name in ("reflection", "admittance")]
        temporary.write_text("\n".join([text, *parts]), encoding="utf-8")


def _dictionary(name: str, held: dict[str, Any]) -> str:
    lines = [name, "{", f"    constant      {held['constant']:.17g};"]
    for key, rows in (("realPoles", held["real_poles"]), ("complexPoles", held["complex_poles"])):
        lines += [f"    {key}", "    ("]
        lines += [f"        ({' '.join(f'{value:.17g}' for value in row)})" for row in rows]
        lines.append("    );")
    return "\n".join([*lines, "}", ""])
