"""Doubts about a line as a whole, with numbers; those of single stations stay with them."""

from __future__ import annotations

from torchliner.records import ImpedanceLine
from torchliner.signals.attenuation import DAMPED

SHOWN = 4  # names in a note


def review_line(line: ImpedanceLine) -> list[str]:
    """What is to be said of a line."""
    return [*_flagged(line), *_damped(line), *_walls(line), *_fallen_back(line), *_others(line)]


def _flagged(line: ImpedanceLine) -> list[str]:
    which = [i for i, flags in enumerate(line.flags) if flags]
    if not which:
        return []
    names = ", ".join(line.names[i] for i in which[:SHOWN])
    more = f" and {len(which) - SHOWN} more" if len(which) > SHOWN else ""
    count = int((~line.used).sum())
    done = "do not count in the averages" if count else "count in the averages all the same"
    return [
        f"{len(which)} of {line.stations} stations are flagged and {done}: {names}{more}; the "
        f"first: {line.flags[which[0]][0]}"
    ]


def _damped(line: ImpedanceLine) -> list[str]:
    notes = []
    sizes = line.attenuation.abs()
    for i, frequency in enumerate(line.frequency.tolist()):
        if float(sizes[:, i].min()) >= DAMPED:
            continue
        corrected = bool(line.corrected[:, i].all())
        said = (
            "the tone is corrected, the turbulence is not"
            if corrected
            else "it is not corrected there"
        )
        notes.append(
            f"{line.choices['method']} reconstruction damps {frequency:g} Hz to "
            f"{float(sizes[:, i].mean()):.3f} in the mean of the stations (least "
            f"{float(sizes[:, i].min()):.3f}); {said}"
        )
    return notes


def _walls(line: ImpedanceLine) -> list[str]:
    if line.wall is None:
        return []
    limit = line.choices["wall_filter"]
    return [
        f"wall filter: {count} of {line.stations} stations have a squared coherence below "
        f"{limit:g} with {frequency:g} Hz and count as wall, admittance 0, in the averages"
        for frequency, count in zip(line.frequency.tolist(), line.wall.sum(0).tolist(), strict=True)
    ]


def _fallen_back(line: ImpedanceLine) -> list[str]:
    share = line.phase_held.mean(0)
    return [
        f"self-consistent phase: at {frequency:g} Hz it held in {100 * held:.3g} % of the segments;"
        " the others, with too little coherence, are 'averaged' instead"
        for frequency, held in zip(line.frequency.tolist(), share.tolist(), strict=True)
        if held < 1
    ]


def _others(line: ImpedanceLine) -> list[str]:
    notes = []
    which = [i for i, said in enumerate(line.station_notes) if said]
    if which:
        notes.append(
            f"{len(which)} of {line.stations} stations have notes of their own (station_notes); "
            f"the first, of {line.names[which[0]]}: {line.station_notes[which[0]][0]}"
        )
    if line.interval is None and line.choices["interval"] is not None:
        notes.append(
            f"no error bars: a station has {int(line.segments.min())} segments, four at least are "
            "needed; a longer record or shorter segments give them"
        )
    return notes
