"""Which height? The lowest plane that passes three tests, with reasons. No truth is used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from torchliner.checks import require_positive
from torchliner.heights.facts import HeightFacts
from torchliner.heights.study import HeightStudy, LengthRow

ACOUSTIC_DRIFT = 0.025 + 0.03j  # per mm, eq. (A1)
CRITERIA = {
    "imprint": "imprint of the cells on v'",
    "orders": "the two orders of averaging differ by",
    "change": "to the next height Z changes by",
}


@dataclass(frozen=True)
class Limits:
    """What a height must keep to; each above 0.

    Args:
        imprint: rms of the cell-periodic part of v'_rms over its mean.
        orders: |Z, probes first - Z, velocity first| over the latter's |Z|, averaged over a cell.
        change: largest change of Z to the next height, either order, over |Z|.
    """

    imprint: float = 0.1
    orders: float = 0.1
    change: float = 0.1

    def __post_init__(self) -> None:
        for name in CRITERIA:
            require_positive(f"limit on {name}", getattr(self, name))


@dataclass(frozen=True)
class Judgement:
    """One height against one limit; ``value`` None where it could not be judged."""

    height: float
    name: str
    value: float | None
    limit: float

    @property
    def passed(self) -> bool:
        """Judged, and within the limit."""
        return self.value is not None and self.value <= self.limit


@dataclass(frozen=True)
class Recommendation:
    """The answer.

    Args:
        height: m; None if no height of these qualifies.
        judgements: every height against every limit, lowest first.
        reasons: in words, with numbers.
        unknown: what could not be judged, and why.
    """

    height: float | None
    judgements: tuple[Judgement, ...]
    reasons: tuple[str, ...]
    unknown: tuple[str, ...]


def recommend_height(study: HeightStudy, limits: Limits | None = None) -> Recommendation:
    """The lowest height where the imprint is small, the orders agree and Z has settled.

    The highest plane has no next one, so it never qualifies. The criteria say that a
    homogenised impedance can be read there; they do not say that it is right.

    Args:
        study: of ``study_heights``.
        limits: default 10 % each, a choice of this program (the paper gives none).
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2 (the trade-off) and appendix A.
    """
    limits = limits or Limits()
    rows = study.at_length(study.cell_length)
    judgements, chosen = [], None
    for i, (row, facts) in enumerate(zip(rows, study.facts, strict=True)):
        following = rows[i + 1] if i + 1 < len(rows) else None
        mine = _judge(row, following, facts, limits)
        judgements += mine
        if chosen is None and all(one.passed for one in mine):
            chosen = i
    reasons = [_answer(study, rows, chosen)]
    for i, facts in enumerate(study.facts):
        mine = judgements[3 * i : 3 * i + 3]
        reasons.append(f"{_mm(facts.height)}: " + "; ".join(_words(one) for one in mine))
    reasons += _context(rows, study.facts, chosen) + _extrapolated(study, limits)
    return Recommendation(
        None if chosen is None else rows[chosen].height,
        tuple(judgements), tuple(reasons), tuple(_unknown(study, judgements)),
    )  # fmt: skip


def _judge(
    row: LengthRow, following: LengthRow | None, facts: HeightFacts, limits: Limits
) -> list[Judgement]:
    values: dict[str, float | None] = dict.fromkeys(CRITERIA)
    if facts.imprint is not None:
        values["imprint"] = facts.imprint.relative
    values["orders"] = _relative(row.probes_first, row.velocity_first)
    if following is not None:
        values["change"] = max(
            _relative(following.probes_first, row.probes_first),
            _relative(following.velocity_first, row.velocity_first),
        )
    return [Judgement(row.height, n, value, getattr(limits, n)) for n, value in values.items()]


def _relative(found: complex, wanted: complex) -> float:
    """|found - wanted| over |wanted|; infinite where one of them is."""
    if not abs(found) < float("inf") or not 0 < abs(wanted) < float("inf"):
        return float("inf")
    return abs(found - wanted) / abs(wanted)


def _answer(study: HeightStudy, rows: Sequence[LengthRow], chosen: int | None) -> str:
    where = f"averaged over {1e3 * study.cell_length:.4g} mm"
    if study.pitch is not None and abs(study.cell_length / study.pitch - 1) < 0.05:
        where = f"averaged over a cell of {1e3 * study.pitch:.4g} mm"
    if chosen is None:
        return f"no height of these qualifies ({where})"
    return f"{_mm(rows[chosen].height)} is the lowest height that passes all three ({where})"


def _words(one: Judgement) -> str:
    label = CRITERIA[one.name]
    if one.value is None:
        return f"{label}: not known"
    sign = "within" if one.passed else "ABOVE"
    return f"{label} {100 * one.value:.3g} % ({sign} {100 * one.limit:g} %)"


def _context(
    rows: Sequence[LengthRow], facts: Sequence[HeightFacts], chosen: int | None
) -> list[str]:
    """Drift of A.1 and jets of A.2 at the chosen height, else at all."""
    lines = []
    for i in range(len(rows)) if chosen is None else [chosen]:
        millimetres = 1e3 * rows[i].height
        drift = ACOUSTIC_DRIFT * millimetres
        share = 100 * abs(drift) / abs(rows[i].velocity_first)
        text = (
            f"{_mm(rows[i].height)}: acoustic drift of (A1), of the order of {drift.real:.3f} + "
            f"{drift.imag:.3f}j, {share:.3g} % of |Z|"
        )
        reach, speed = facts[i].jet_height, facts[i].jet_velocity
        if reach is not None:
            side = "above" if rows[i].height > reach else "BELOW"
            text += f"; {side} the jets' height, {1e3 * reach:.3g} mm (A.2, U_j {speed:.3g} m/s)"
        lines.append(text)
    return lines


def _extrapolated(study: HeightStudy, limits: Limits) -> list[str]:
    """Where the fitted decay of the imprint would meet its limit."""
    decay = study.decay
    if decay is None:
        return []
    length, sound = 1e3 * decay.length, 1e3 * decay.evanescent
    fitted = f"{length:.3g} mm (the first harmonic of sound: {sound:.3g} mm)"
    if not decay.follows:
        return [
            f"the imprint does not follow a decay with height: fitted l = {fitted}, from which the "
            f"heights stray by a factor {decay.scatter:.3g}"
        ]
    reached = math.log(decay.amplitude / limits.imprint) / decay.rate
    beyond = "beyond the planes: an extrapolation" if reached > study.facts[-1].height else "fitted"
    return [
        f"the imprint falls as exp(-y/l) with l = {fitted}; it meets {100 * limits.imprint:g} % at "
        f"{_mm(max(reached, 0.0))} ({beyond})"
    ]


def _unknown(study: HeightStudy, judgements: Sequence[Judgement]) -> list[str]:
    lines = []
    top = study.facts[-1].height
    if len(study.facts) == 1:
        lines.append("with one height, whether Z has settled cannot be judged; give several planes")
    else:
        lines.append(f"{_mm(top)} has no plane above it: whether Z has settled there is not known")
    if any(one.name == "imprint" and one.value is None for one in judgements):
        lines.append("the cells' imprint: no cell pitch, or no whole cell under the probes")
    if all(facts.jet_height is None for facts in study.facts):
        lines.append("the jets' height: see the notes")
    if study.decay is None:
        lines.append("a decay of the imprint with height needs three heights and whole cells")
    between = [f.imprint.between for f in study.facts if f.imprint is not None]
    if between and between[0] is None:
        lines.append("whether the imprint repeats from cell to cell: there is one cell")
    return lines


def _mm(height: float) -> str:
    return f"y = {1e3 * height:.3g} mm"
