"""torchliner liner."""

from __future__ import annotations

import argparse
from contextlib import suppress
from pathlib import Path
from typing import Any

import torchliner as tl
from torchliner.cli import options as opt
from torchliner.cli.files import show_results, write_copy

EXAMPLES = ("onera --frequency 500:3000:500", "onera --copy mine.toml")
FREQUENCIES = [500.0, 1000.0, 1400.0, 1500.0, 2000.0, 3000.0]
OPTIONS = [
    opt.Option("liners", "presets, .toml, .csv or .py files; without: list the presets", opt.LINER, nargs="*"),
    opt.frequency(" ".join(f"{f:g}" for f in FREQUENCIES), values=FREQUENCIES),
    opt.Option("--speed", "|v|, m/s; default 0 1 3 5", opt.MPS, nargs="+", default=[0.0, 1.0, 3.0, 5.0]),
    *opt.figure("draw Z over frequency there; of several liners the linear Z"),
    opt.COPY,
    *opt.PRINTING,
]


def run(options: argparse.Namespace) -> int:
    """Print geometry, resonance, table; draw."""
    from torchliner.liners.catalogue import preset_text

    if not options.liners:
        print("presets: " + ", ".join(tl.preset_names()))
        return 0
    if options.copy is not None and len(options.liners) != 1:
        raise ValueError("--copy writes one preset; name one")
    liners = {name: tl.load_liner(name) for name in options.liners}
    if options.copy is not None:
        write_copy(preset_text(options.liners[0]), options.copy)
    found: list[dict[str, Any]] = []
    for liner in liners.values():
        table = [
            {"frequency": f, "speed": v, "impedance": complex(liner.impedance(f, v))}
            for f in options.frequency
            if liner.frequency_range is None or liner.frequency_range[0] <= f <= liner.frequency_range[1]
            for v in options.speed
        ]
        found.append({"liner": _facts(liner), "table": table})
    text = "\n".join(
        _text(one["liner"], _units(liner), one["table"], options.speed)
        for one, liner in zip(found, liners.values(), strict=True)
    )
    plain = found if len(found) > 1 else found[0]
    show_results(options, text, plain, figure=lambda path: _draw(liners, options.speed, path))
    return 0


def _facts(liner: Any) -> dict[str, Any]:
    """What it states: of a table its band alone, layers by name, and the resonance, None where there is none."""
    facts = liner.describe()
    if "resistance" in facts:
        low, high = liner.frequency_range
        return {"model": facts["model"], "name": facts["name"], "low": low, "high": high}
    if "layers" in facts:
        named = dict(zip(liner.named_layers(), facts.pop("layers"), strict=True))
        facts = {"model": facts.pop("model"), **named, **facts}
    if hasattr(liner, "resonance"):
        facts["resonance_hz"] = None
        with suppress(ValueError):
            facts["resonance_hz"] = liner.resonance()
    return facts


def _units(liner: Any) -> dict[str, str]:
    """Units of what has one, by name; those of a layer as in "facesheet.thickness"."""
    from torchliner.liners.parameters import parameters_of

    kind: Any = type(liner)
    stated = {**parameters_of(kind), **liner.numbers()}
    return {name: f" {each.unit}" for name, each in stated.items() if each.unit != "1"}


def _text(facts: dict[str, Any], units: dict[str, str], table: list[dict[str, Any]], speeds: list[float]) -> str:
    from torchliner.report.table import format_complex

    lines = []
    for key, value in facts.items():
        if key == "fluid":
            value = ", ".join(f"{name} {number:g}" for name, number in value.items())
        layer = dict(value) if isinstance(value, dict) else {}
        lines.append(_fact(key, layer.pop("kind", value), units.get(key, "")))
        lines += [_fact(f"  {name}", number, units.get(f"{key}.{name}", "")) for name, number in layer.items()]
    lines.append("\nZ, normalised by rho c, at |v| in m/s")
    lines.append(f"{'f Hz':>8s}" + "".join(f"{f'|v| = {v:g}':>18s}" for v in speeds))
    for first in range(0, len(table), len(speeds)):
        row = table[first : first + len(speeds)]
        cells = "".join(f"{format_complex(cell['impedance']):>18s}" for cell in row)
        lines.append(f"{row[0]['frequency']:8.1f}{cells}")
    return "\n".join(lines)


def _fact(key: str, value: Any, unit: str) -> str:
    return f"{key:26s} {value:.6g}{unit}" if isinstance(value, float) else f"{key:26s} {value}"


def _draw(liners: dict[str, Any], speeds: list[float], path: Path) -> None:
    """One liner: a curve a speed. Several: the linear impedance of each (figure 3)."""
    from torchliner.report.figures import draw_liner
    from torchliner.report.numbers import impedance_over_band

    one = len(liners) == 1
    curves = [
        impedance_over_band(liner, speed, f"$|v|$ = {speed:g} m s$^{{-1}}$" if one else Path(name).stem)
        for name, liner in liners.items()
        for speed in (speeds if one else [0.0])
    ]
    draw_liner(curves, f"liner model {Path(next(iter(liners))).stem}" if one else "linear impedance", path)
