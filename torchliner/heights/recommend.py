"""Which height? For each averaging the lowest plane where it holds. No reference impedance is used."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from torchliner.checks import require_positive
from torchliner.heights.facts import HeightFacts
from torchliner.heights.study import HeightStudy

ACOUSTIC_DRIFT = 0.025 + 0.03j  # per mm, eq. (A1), for sound at grazing incidence
GRAZING = ("upstream", "downstream")
CRITERIA = {
    "level check": "level check off by",
    "change": "to the next height Z changes by",
    "turbulence": "out of step with the tone",
    "averagings": "admittance and velocity differ by",
    "imprint": "cell-periodic modulation of v'",
}


@dataclass(frozen=True)
class Limits:
    """What a height must keep to; each above 0.

    Args:
        imprint: rms of the cell-periodic part of v'_rms over its mean.
        averagings: |Z, admittance - Z, velocity| over the latter's |Z|.
        change: of Z to the next height, over |Z|.
        turbulence: share of v'^2 at the tone's frequency that keeps no step with it, 1 - coherence.
    """

    imprint: float = 0.1
    averagings: float = 0.1
    change: float = 0.1
    turbulence: float = 0.1

    def __post_init__(self) -> None:
        for name, value in vars(self).items():
            require_positive(f"limit on {name}", value)


@dataclass(frozen=True)
class Judgement:
    """One height and averaging against one limit; ``value`` None where it could not be judged.

    Shares of 1, for ``level check`` dB.
    """

    height: float
    name: str
    value: float | None
    limit: float
    averaging: str

    @property
    def passed(self) -> bool:
        """Judged, and within the limit."""
        return self.value is not None and self.value <= self.limit


@dataclass(frozen=True)
class Recommendation:
    """The answer.

    Args:
        height: m, for the averaging of the answer; None if no height of these qualifies.
        judgements: every height and averaging against what that averaging needs, lowest first.
        reasons: in words, with numbers.  unknown: what could not be judged, and why.
        heights: by averaging.
    """

    height: float | None
    judgements: tuple[Judgement, ...]
    reasons: tuple[str, ...]
    unknown: tuple[str, ...]
    heights: dict[str, float | None]


def recommend_height(study: HeightStudy, limits: Limits | None = None) -> Recommendation:
    """For each averaging, the lowest height where what it rests on holds.

    Where the level check was made it decides alone. Else Z of that averaging must have settled, so that the highest
    plane, which has no next one, never qualifies, and besides:

    - ``velocity`` needs a velocity in step with the tone: turbulence averages out of it, and the resistance that it
      makes with it. Cell-periodic modulation does not matter to it: what passes the cell passes the holes.
    - ``phase-locked`` needs no more;
    - ``admittance`` must agree with ``velocity`` where v is in step (else a probe sees a jet and not the cell), and
      needs little cell-periodic modulation where it is not.

    None of this says that Z is right.

    Args:
        study: of ``study_heights``.
        limits: default 10 % each, a choice of this program (the paper gives none).
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2 (the trade-off) and appendix A.
    """
    limits = limits or Limits()
    judgements: list[Judgement] = []
    reasons: list[str] = []
    heights: dict[str, float | None] = {}
    for averaging in study.facts[0].impedance:
        mine = [_judge(study.facts, i, averaging, limits) for i in range(len(study.facts))]
        stands = [
            facts.height for facts, one in zip(study.facts, mine, strict=True) if all(each.passed for each in one)
        ]
        heights[averaging] = stands[0] if stands else None
        reasons.append(_answer(study.facts, averaging, heights[averaging]))
        for facts, one in zip(study.facts, mine, strict=True):
            judgements += one
            reasons.append(f"  {_mm(facts.height)}: " + "; ".join(map(_words, one)))
    default = study.averaging
    reasons += _context(study, heights[default], default) + _extrapolated(study, limits)
    return Recommendation(
        heights[default], tuple(judgements), tuple(reasons), tuple(_unknown(study, judgements)), heights
    )


def _judge(facts: Sequence[HeightFacts], i: int, averaging: str, limits: Limits) -> list[Judgement]:
    """What one averaging needs at one height."""
    here, gap = facts[i], facts[i].level_check.get(averaging, math.nan)
    if math.isfinite(gap):
        return [Judgement(here.height, "level check", abs(gap), here.level_limit, averaging)]
    values: dict[str, float | None] = {"change": None}
    if i + 1 < len(facts):
        values["change"] = _relative(facts[i + 1].impedance[averaging], here.impedance[averaging])
    in_step = here.coherence >= 1 - limits.turbulence
    if averaging == "velocity":
        values["turbulence"] = 1 - here.coherence if math.isfinite(here.coherence) else None
    elif averaging == "admittance" and in_step:
        values["averagings"] = _relative(here.impedance["admittance"], here.impedance["velocity"])
    elif averaging == "admittance":
        values["imprint"] = None if here.imprint is None else here.imprint.relative
    return [Judgement(here.height, name, value, getattr(limits, name), averaging) for name, value in values.items()]


def _relative(found: complex, wanted: complex) -> float:
    """|found - wanted| over |wanted|; infinite where one of them is."""
    if not abs(found) < float("inf") or not 0 < abs(wanted) < float("inf"):
        return float("inf")
    return abs(found - wanted) / abs(wanted)


def _answer(facts: Sequence[HeightFacts], averaging: str, height: float | None) -> str:
    """Where one averaging holds, and how far it moves over all heights."""
    values = [one.impedance[averaging] for one in facts]
    moves = max(_relative(value, values[0]) for value in values)
    where = ("no height of these qualifies" if height is None
             else f"{_mm(height)} is the lowest height where it holds")  # fmt: skip
    known = "by the level check" if facts[0].level_check else "level not checked"
    spread = f"; from {_mm(facts[0].height)} Z moves by up to {100 * moves:.3g} %"
    return f"{averaging}: {where} ({known}{spread if len(facts) > 1 else ''})"


def _words(one: Judgement) -> str:
    label = CRITERIA[one.name]
    if one.value is None:
        return f"{label}: not known"
    unit, scale = ("dB", 1) if one.name == "level check" else ("%", 100)
    sign = "within" if one.passed else "ABOVE"
    return f"{label} {scale * one.value:.3g} {unit} ({sign} {scale * one.limit:g} {unit})"


def _context(study: HeightStudy, chosen: float | None, averaging: str) -> list[str]:
    """Drift of A.1, for sound that grazes, and jets of A.2, at the chosen height, else at all."""
    lines = []
    if study.source_side == "normal":
        lines.append("(A1) is the drift of grazing sound; this sound comes at normal incidence")
    elif study.source_side not in GRAZING:
        lines.append("(A1) is not applied: no side that grazing sound comes from is stated")
    for facts in study.facts:
        if chosen not in (None, facts.height):
            continue
        parts = []
        if study.source_side in GRAZING:
            drift = ACOUSTIC_DRIFT * 1e3 * facts.height
            share = 100 * abs(drift) / abs(facts.impedance[averaging])
            parts.append(
                f"acoustic drift of (A1), of the order of {drift.real:.3f} + {drift.imag:.3f}j, {share:.3g} % of |Z|"
            )
        if facts.jet_height is not None:
            side = "above" if facts.height > facts.jet_height else "BELOW"
            parts.append(f"{side} the jets' height, {1e3 * facts.jet_height:.3g} mm (A.2, U_j "
                         f"{facts.jet_velocity:.3g} m/s)")  # fmt: skip
        if parts:
            lines.append(f"{_mm(facts.height)}: {'; '.join(parts)}")
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
            f"the cell-periodic modulation does not follow a decay with height: fitted l = {fitted}, from which the "
            f"heights stray by a factor {decay.scatter:.3g}"
        ]
    reached = math.log(decay.amplitude / limits.imprint) / decay.rate
    beyond = "beyond the planes: an extrapolation" if reached > study.facts[-1].height else "fitted"
    return [
        f"the cell-periodic modulation falls as exp(-y/l) with l = {fitted}; it meets {100 * limits.imprint:g} % at "
        f"{_mm(max(reached, 0.0))} ({beyond})"
    ]


def _unknown(study: HeightStudy, judgements: Sequence[Judgement]) -> list[str]:
    lines = []
    top = study.facts[-1].height
    if all(one.name == "level check" for one in judgements):
        pass
    elif len(study.facts) == 1:
        lines.append("with one height, whether Z has settled cannot be judged; give several planes")
    else:
        lines.append(f"{_mm(top)} has no plane above it: whether Z has settled there is not known")
    if any(one.name == "imprint" and one.value is None for one in judgements):
        lines.append("the cell-periodic modulation: no cell pitch, or no whole cell under the probes")
    if all(facts.jet_height is None for facts in study.facts):
        lines.append("the jets' height: see the notes")
    if study.decay is None:
        lines.append("a decay of the modulation with height needs three heights and whole cells")
    between = [f.imprint.between for f in study.facts if f.imprint is not None]
    if between and between[0] is None:
        lines.append("whether the modulation repeats from cell to cell: there is one cell")
    return lines


def _mm(height: float) -> str:
    return f"y = {1e3 * height:.3g} mm"
