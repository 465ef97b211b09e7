"""The answers of stations of bursts and of impedance over level."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any

from torchliner.bursts.stations import Station, zero_shares
from torchliner.report.answer import Answer, Picture
from torchliner.report.bursts import draw_stations, intervals_of, moment_of
from torchliner.report.studies import draw_levels
from torchliner.report.table import if_known, table_of
from torchliner.velocity.level_curve import LevelCurve

COMPONENTS = {"v": "wall_normal", "u": "streamwise"}
MOMENTS = ("mean", "rms", "weighted_mean", "weighted_rms")
Row = dict[str, Any]


def of_stations(stations: Sequence[Station], source: Path | None = None) -> Answer:
    """One row per station; what was dropped and why; flags and notes."""
    rows = [_station(one) for one in stations]
    count = sum(1 for one in stations if one.flags)
    moments = [f"{short} {key} (m/s)" for short in COMPONENTS for key in MOMENTS]
    shown = "station,x,y,z,bursts,dropped,duration,rate,longest_gap,flags"
    dropped = [f"{one.name}: {n} dropped: {why}" for one in stations for why, n in one.kept.dropped.items()]
    if any(not one.moments.weighted for one in stations):
        dropped.append("no transit times at some stations: weighted moments are not weighted there")
    plain = [
        row | {"flags": one.flags, "dropped": dict(one.kept.dropped), "notes": list(one.kept.notes)}
        for row, one in zip(rows, stations, strict=True)
    ]
    picture = Picture(
        "stations",
        "Moments, rates and intervals between bursts of each station",
        partial(draw_stations, stations),
        lambda: intervals_of(stations).table,
    )
    return Answer(
        title=f"{len(stations)} stations of bursts",
        lines=[f"{count} of {len(stations)} stations are flagged" if count else "no flags"],
        table=table_of(rows, shown + if_known(rows, *moments)),
        brief=table_of(rows, shown + if_known(rows, "v mean (m/s)", "v rms (m/s)")),
        plain=plain,
        remarks=dropped,
        notes=[f"{one.name}: {text}" for one in stations for text in (*one.flags, *one.kept.notes)],
        pictures=[picture],
        source=source,
    )


def _station(one: Station) -> Row:
    """All that is known of the bursts of a station."""
    kept, seen = one.kept, one.moments
    row: Row = {"station": one.name, "x": kept.x, "y": kept.y, "z": kept.z, "received": kept.received}
    row |= {"bursts": kept.bursts, "dropped": kept.received - kept.bursts, "duration": seen.duration}
    row |= {"rate": seen.rate, "longest_gap": seen.longest_gap, "irregularity": seen.irregularity}
    for short, name in COMPONENTS.items():
        row |= {f"{short} {key} (m/s)": moment_of(one, name, key) for key in MOMENTS}
        row[f"{short} zero share"] = zero_shares(one.raw).get(name)
    return row | {"flags": len(one.flags)}


def of_curve(curves: Sequence[LevelCurve], source: Path | None = None) -> Answer:
    """One row per level and frequency; ``fixed_point`` is that of the lowest speed."""
    (curve,) = curves
    rows, chosen = list[Row](), curve.choices
    for i, (level, roots) in enumerate(zip(curve.level.tolist(), curve.fixed_points, strict=True)):
        about: Row = {"level": level, "rms_speed": float(curve.rms_speed[i].square().mean().sqrt())}
        about |= {"peak_speed": float(curve.peak_speed[i].max()), "drift": float(curve.drift[i].max())}
        about |= {"residual": float(curve.residual[i].max()), "fixed_points": len(roots)}
        about |= {"reflected_energy": float(curve.reflected_energy[i].mean())}
        about |= {"several_solutions": int(curve.several[i].max()), "realisations": curve.reflection.shape[1]}
        about |= {name: chosen[name] for name in ("kernel", "drive", "incident", "kernel_error")}
        for j, frequency in enumerate(curve.frequency.tolist()):
            z: Row = {"frequency": frequency, "impedance": complex(curve.impedance[i, j])}
            z |= {"spread": complex(curve.spread[i, j]), "frozen": complex(curve.frozen[i, j])}
            z["fixed_point"] = complex(roots[0].impedance[j]) if roots else None
            rows.append(about | z)
    kernel = ": the model's response, no kernel"
    if chosen["kernel"] != "periodic":
        low, high = chosen["kernel_band"]
        kernel = (
            f", error in R {chosen['kernel_error']:.1e} on {low:g}-{high:g} Hz, gain {chosen['kernel_gain']:.3g}; "
            "kernel's part: what it changes with |v| frozen at its rms"
        )
    remarks = [f"Z over ρc; kernel {chosen['kernel']}{kernel}."]
    for level, roots in zip(curve.level.tolist(), curve.fixed_points, strict=True):
        if len(roots) != 1:
            speeds = ", ".join(f"{root.speed:.4g} m/s" for root in roots) or "none"
            remarks.append(f"At {level:g} dB the fixed point Z(rms v) has {len(roots)}: {speeds}.")
    every = [[{"speed": speed, "impedance": z.tolist()} for speed, z in each] for each in curve.fixed_points]
    caption = "Resistance and reactance over the level of the incident wave"
    return Answer(
        title=f"{chosen['liner']}: {chosen['incident']}",
        lines=[
            f"Drive {chosen['drive']}, {curve.reflection.shape[1]} realisation(s) of {1e3 * chosen['duration']:.4g} ms "
            f"at {chosen['sampling_rate']:g} Hz, kernel {chosen['kernel']}."
        ],
        table=table_of(rows, "level,frequency,impedance,spread,rms_speed,peak_speed,fixed_point,frozen,drift,residual"),
        brief=table_of(rows, "level,frequency,impedance,rms_speed,fixed_point"),
        plain=chosen | {"fixed_points": every, "rows": rows},
        remarks=remarks,
        pictures=[Picture("levels", caption, partial(draw_levels, curve), lambda: table_of(rows))],
        source=source,
    )
