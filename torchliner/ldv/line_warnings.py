"""What a user is to be warned of about a line."""

from __future__ import annotations

from collections.abc import Iterator

from torchliner.records import ImpedanceLine
from torchliner.signals.attenuation import DAMPED

SHOWN = 4  # names in a warning


def warnings_of(line: ImpedanceLine) -> list[str]:
    """One sentence for each thing about a line that is doubtful, with numbers."""
    checks = (_flagged, _damped, _walls, _fallen_back, _station_notes, _no_interval, _level_check)
    return [text for check in checks for text in check(line)]


def _flagged(line: ImpedanceLine) -> Iterator[str]:
    which = [i for i, flags in enumerate(line.flags) if flags]
    if not which:
        return
    names = ", ".join(line.names[i] for i in which[:SHOWN])
    more = f" and {len(which) - SHOWN} more" if len(which) > SHOWN else ""
    counted = "count in the averages all the same"
    yield (
        f"{len(which)} of {line.stations} stations are flagged and "
        f"{counted if bool(line.used.all()) else 'do not count in the averages'}: {names}{more}; "
        f"the first: {line.flags[which[0]][0]}"
    )


def _damped(line: ImpedanceLine) -> Iterator[str]:
    sizes = line.attenuation.abs()
    for i, frequency in enumerate(line.frequency.tolist()):
        if float(sizes[:, i].min()) < DAMPED:
            corrected = "the tone is corrected, the turbulence is not"
            yield (
                f"{line.choices['method']} reconstruction damps {frequency:g} Hz to "
                f"{float(sizes[:, i].mean()):.3f} in the mean of the stations (least "
                f"{float(sizes[:, i].min()):.3f}); "
                f"{corrected if bool(line.corrected[:, i].all()) else 'it is not corrected there'}"
            )


def _walls(line: ImpedanceLine) -> Iterator[str]:
    if line.wall is None:
        return
    for frequency, count in zip(line.frequency.tolist(), line.wall.sum(0).tolist(), strict=True):
        yield (
            f"wall filter: {count} of {line.stations} stations have a squared coherence below "
            f"{line.choices['wall_filter']:g} with {frequency:g} Hz and count as wall, admittance "
            "0, in the averages"
        )


def _fallen_back(line: ImpedanceLine) -> Iterator[str]:
    shares = line.phase_held.mean(0).tolist()
    for frequency, share in zip(line.frequency.tolist(), shares, strict=True):
        if share < 1:
            yield (
                f"self-consistent phase: at {frequency:g} Hz it held in {100 * share:.3g} % of the "
                "segments; the others, with too little coherence, are 'averaged' instead"
            )


def _station_notes(line: ImpedanceLine) -> Iterator[str]:
    which = [i for i, notes in enumerate(line.station_notes) if notes]
    if which:
        yield (
            f"{len(which)} of {line.stations} stations have notes of their own (station_notes); "
            f"the first, of {line.names[which[0]]}: {line.station_notes[which[0]][0]}"
        )


def _no_interval(line: ImpedanceLine) -> Iterator[str]:
    if line.interval is None and line.choices["interval"] is not None:
        yield (
            f"no error bars: a station has {int(line.segments.min())} segments, four at least are "
            "needed; a longer record or shorter segments give them"
        )


def _level_check(line: ImpedanceLine) -> Iterator[str]:
    if line.level_check is not None:
        texts = (line.level_check.sentence("stations", f, i)
                 for i, f in enumerate(line.frequency.tolist()))  # fmt: skip
        yield from filter(None, texts)
