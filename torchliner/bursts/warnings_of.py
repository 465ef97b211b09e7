"""What a user is to be warned of about a line."""

from __future__ import annotations

from collections.abc import Iterator

from torchliner.bursts.tone_damping import DAMPED
from torchliner.records import ImpedanceLine

SHOWN = 4  # names in a warning


def warnings_of(line: ImpedanceLine) -> Iterator[str]:
    """One sentence for each thing about a line that is doubtful, with numbers."""
    count, choices = line.stations, line.choices
    flagged = [i for i, flags in enumerate(line.flags) if flags]
    if flagged:
        more = f" and {len(flagged) - SHOWN} more" if len(flagged) > SHOWN else ""
        counted = "count in the averages all the same" if bool(line.used.all()) else "do not count in the averages"
        yield (
            f"{len(flagged)} of {count} stations are flagged and {counted}: "
            f"{', '.join(line.names[i] for i in flagged[:SHOWN])}{more}; the first: {line.flags[flagged[0]][0]}"
        )
    for i, f in enumerate(line.frequency.tolist()):
        yield from _at_frequency(line, i, f)
    noted = [i for i, notes in enumerate(line.station_notes) if notes]
    if noted:
        yield (
            f"{len(noted)} of {count} stations have notes of their own (station_notes); the first, of "
            f"{line.names[noted[0]]}: {line.station_notes[noted[0]][0]}"
        )
    if line.interval is None and choices["interval"] is not None:
        yield (
            f"no error bars: a station has {int(line.segments.min())} segments, four at least are needed; a longer "
            "record or shorter segments give them"
        )
    if line.level_check is not None:
        yield from filter(
            None, (line.level_check.sentence("stations", f, i) for i, f in enumerate(line.frequency.tolist()))
        )


def _at_frequency(line: ImpedanceLine, i: int, f: float) -> Iterator[str]:
    """The tone that is damped, stations that count as wall, segments where the phase rule did not hold."""
    sizes, share = line.attenuation[:, i].abs(), float(line.phase_held[:, i].mean())
    if float(sizes.min()) < DAMPED:
        corrected = "the tone is corrected, the turbulence is not"
        yield (
            f"{line.choices['method']} reconstruction damps {f:g} Hz to {float(sizes.mean()):.3f} in the mean of the "
            f"stations (least {float(sizes.min()):.3f}); "
            f"{corrected if bool(line.corrected[:, i].all()) else 'it is not corrected there'}"
        )
    if line.wall is not None:
        yield (
            f"wall filter: {int(line.wall[:, i].sum())} of {line.stations} stations have a squared coherence below "
            f"{line.choices['wall_filter']:g} with {f:g} Hz and count as wall, admittance 0, in the averages"
        )
    if share < 1:
        yield (
            f"self-consistent phase: at {f:g} Hz it held in {100 * share:.3g} % of the segments; the others, with too "
            "little coherence, are 'averaged' instead"
        )
