"""What a user is to be warned of about a line."""

from __future__ import annotations

from collections.abc import Iterator

from torchliner.bursts.segments import DAMPED
from torchliner.records import ImpedanceLine
from torchliner.records.notes import Note

ARRIVALS_A_PERIOD = 8.0  # warned of below
SHOWN = 4  # names in a warning


def notes_of(line: ImpedanceLine) -> Iterator[Note]:
    """One note for each thing about a line that is doubtful, with numbers."""
    count, choices, rate = line.stations, line.choices, float(line.rate.min())
    flagged = [i for i, flags in enumerate(line.flags) if flags]
    if flagged:
        shown = ", ".join(line.names[i] for i in flagged[:SHOWN]) + ", ..." * (len(flagged) > SHOWN)
        counted = "count in the averages all the same" if bool(line.used.all()) else "do not count in the averages"
        text = f"{len(flagged)} of {count} stations are flagged and {counted}: {shown}; the first: "
        yield Note("flagged-stations", text + line.flags[flagged[0]][0])
    for i, f in enumerate(line.frequency.tolist()):
        sizes, share = line.attenuation[:, i].abs(), float(line.phase_held[:, i].mean())
        if float(sizes.min()) < DAMPED:
            text = f"{choices['method']} reconstruction damps {f:g} Hz to {float(sizes.mean()):.3f} in the mean of the"
            mended = "the tone is corrected, the turbulence is not"
            mended = mended if bool(line.corrected[:, i].all()) else "it is not corrected there"
            yield Note("damped-tone", f"{text} stations (least {float(sizes.min()):.3f}); {mended}")
        if rate < ARRIVALS_A_PERIOD * f:
            text = f"{rate / f:.3g} arrivals a period of {f:g} Hz (limit {ARRIVALS_A_PERIOD:g})"
            yield Note("few-arrivals", f"{text}: |v(t)| between them is guessed")
        if line.wall is not None:
            text = f"wall filter: {int(line.wall[:, i].sum())} of {count} stations have a squared coherence below"
            text = f"{text} {choices['wall_filter']:g} with {f:g} Hz and count as wall, admittance 0, in the averages"
            yield Note("wall-filter", text)
        if share < 1:
            text = f"self-consistent phase: at {f:g} Hz it held in {100 * share:.3g} % of the segments; the others,"
            yield Note("phase-fell-back", f"{text} with too little coherence, are 'averaged' instead")
        check = line.level_check
        if check is not None and (sentence := check.sentence("stations", f, i)):
            yield Note("level-check", sentence)
    noted = [i for i, notes in enumerate(line.station_notes) if notes]
    if noted:
        text = f"{len(noted)} of {count} stations have notes of their own (station_notes); the first, of "
        yield Note("station-notes", f"{text}{line.names[noted[0]]}: {line.station_notes[noted[0]][0]}")
    if line.interval is None and choices["interval"] is not None:
        text = f"no error bars: a station has {int(line.segments.min())} segments, four are the least"
        yield Note("no-intervals", text)
