"""Probes that see no sound count as wall: the coherence filter of section 7.2."""

from __future__ import annotations

from torch import Tensor

from torchliner.eduction.prepare import Prepared

SAME_TONE = 1e-6  # relative


def find_walls(ready: Prepared) -> tuple[Tensor | None, list[str]]:
    """Probes whose squared coherence with the tone is below ``wall_filter``, and what to say.

    Args:
        ready: prepared plane.
    Returns:
        (P, F) bool, None without a filter; notes with the share of such probes.
    Source: Roncen et al. (2026), section 7.2, which names no threshold and no estimator; the
        coherence here is that of ``survey``, over segments of two periods.
    """
    limit = ready.chosen.wall_filter
    if limit is None:
        return None, []
    probes, segments = ready.plane.probes, ready.seen.segments
    kept = ready.used.to(ready.seen.coherence.device)
    wall = (ready.seen.coherence[:probes] < limit) & kept[:, None]
    counts = wall.sum(0)
    chance = (1 - limit) ** (segments - 1)
    notes = []
    for f, count in zip(ready.frequency.tolist(), counts.tolist(), strict=True):
        total = int(kept.sum())
        text = (
            f"wall filter: {count} of {total} probes ({100 * count / total:.3g} %) of "
            f"{ready.plane.name} have a squared coherence below {limit:g} with {f:g} Hz and count "
            "as wall, admittance 0, in the averages over probes; those with velocity first are as "
            f"without the filter. Without any tone {100 * chance:.2g} % of probes would pass it, "
            f"with {segments} segments"
        )
        tone = ready.plane.frequency
        if tone is not None and abs(f / tone - 1) > SAME_TONE:
            text += f"; the tone of the data is {tone:g} Hz, so this filters turbulence, not sound"
        notes.append(text)
    return wall, notes
