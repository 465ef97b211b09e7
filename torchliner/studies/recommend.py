"""Which height? For each averaging the lowest plane where it holds. No reference impedance is used."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence

from torchliner.checks import require_positive
from torchliner.studies.rows import Row, Study

ACOUSTIC_DRIFT = 0.025 + 0.03j  # per mm, eq. (A1), for sound at grazing incidence
GRAZING = ("upstream", "downstream")
CRITERIA = {
    "level check": "level check off by",
    "change": "to the next height Z changes by",
    "turbulence": "out of step with the tone",
    "averagings": "admittance and velocity differ by",
    "modulation": "cell-periodic modulation of v'",
}


def recommend_height(
    study: Study, modulation: float = 0.1, averagings: float = 0.1, change: float = 0.1, turbulence: float = 0.1
) -> Study:
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
        modulation, averagings, change, turbulence: limits, a choice of this program (the paper gives none): rms of the
            cell-periodic part of v'_rms over its mean; |Z, admittance - Z, velocity| over the latter's |Z|; change of Z
            to the next height, over |Z|; share of v'^2 at the tone's frequency that keeps no step with it.
    Returns:
        heights (m, by averaging; None where no height qualifies), height (that of the averaging of the answer),
        reasons (in words, with numbers), unknown (what could not be judged, and why), and ``rows``, every height and
        averaging against what that averaging needs, lowest first: height, averaging, name (a key of ``CRITERIA``),
        value (share of 1, for ``level check`` dB; None where it could not be judged), limit, passed.
    Source: Roncen et al. (2026), sections 5.5.2 and 7.2 (the trade-off) and appendix A.
    """
    limits = {"modulation": modulation, "averagings": averagings, "change": change, "turbulence": turbulence}
    for name, limit in limits.items():
        require_positive(f"limit on {name}", limit)
    facts, rows, reasons = study.facts, list[Row](), list[str]()
    heights: dict[str, float | None] = {}
    for averaging in facts[0].impedance:
        mine = [_judge(facts, i, averaging, limits) for i in range(len(facts))]
        heights[averaging] = next((one[0].height for one in mine if all(each.passed for each in one)), None)
        reasons.append(_answer(facts, averaging, heights[averaging]))
        reasons += [f"  {_mm(one[0].height)}: " + "; ".join(map(_words, one)) for one in mine]
        rows += [each for one in mine for each in one]
    chosen = heights[study.averaging]
    reasons += [*_context(study, chosen), *_extrapolated(study, modulation)]
    return Study(height=chosen, heights=heights, rows=rows, reasons=reasons, unknown=_unknown(study, rows))


def _judge(facts: Sequence[Row], i: int, averaging: str, limits: Mapping[str, float]) -> list[Row]:
    """What one averaging needs at one height."""
    here, gap = facts[i], facts[i].level_check.get(averaging)
    values: dict[str, float | None] = {"change": None} if gap is None else {"level check": abs(gap)}
    if gap is None and i + 1 < len(facts):
        values["change"] = _relative(facts[i + 1].impedance[averaging], here.impedance[averaging])
    if gap is None and averaging == "velocity":
        values["turbulence"] = 1 - here.coherence if math.isfinite(here.coherence) else None
    elif gap is None and averaging == "admittance" and here.coherence >= 1 - limits["turbulence"]:
        values["averagings"] = _relative(here.impedance["admittance"], here.impedance["velocity"])
    elif gap is None and averaging == "admittance":
        values["modulation"] = here.modulation
    kept = {**limits, "level check": here.level_limit}
    return [
        Row(
            height=here.height,
            averaging=averaging,
            name=name,
            value=value,
            limit=kept[name],
            passed=value is not None and value <= kept[name],
        )
        for name, value in values.items()
    ]


def _words(one: Row) -> str:
    """What is judged, the value and the limit."""
    if one.value is None:
        return f"{CRITERIA[one.name]}: not known"
    unit, scale = ("dB", 1) if one.name == "level check" else ("%", 100)
    side = "within" if one.passed else "ABOVE"
    return f"{CRITERIA[one.name]} {scale * one.value:.3g} {unit} ({side} {scale * one.limit:g} {unit})"


def _relative(found: complex, wanted: complex) -> float:
    """|found - wanted| over |wanted|; infinite where one of them is."""
    known = abs(found) < math.inf and 0 < abs(wanted) < math.inf
    return abs(found - wanted) / abs(wanted) if known else math.inf


def _answer(facts: Sequence[Row], averaging: str, height: float | None) -> str:
    """Where one averaging holds, and how far it moves over all heights."""
    values = [one.impedance[averaging] for one in facts]
    where = "no height of these qualifies" if height is None else f"{_mm(height)} is the lowest height where it holds"
    known = "by the level check" if facts[0].level_check else "level not checked"
    if len(facts) > 1:
        moves = max(_relative(value, values[0]) for value in values)
        known += f"; from {_mm(facts[0].height)} Z moves by up to {100 * moves:.3g} %"
    return f"{averaging}: {where} ({known})"


def _context(study: Study, chosen: float | None) -> list[str]:
    """Drift of A.1, for sound that grazes, and jets of A.2, at the chosen height, else at all."""
    lines, grazes = [], study.source_side in GRAZING
    if study.source_side == "normal":
        lines.append("(A1) is the drift of grazing sound; this sound comes at normal incidence")
    elif not grazes:
        lines.append("(A1) is not applied: no side that grazing sound comes from is stated")
    for facts in (facts for facts in study.facts if chosen in (None, facts.height)):
        parts = []
        if grazes:
            drift = ACOUSTIC_DRIFT * 1e3 * facts.height
            share = 100 * abs(drift) / abs(facts.impedance[study.averaging])
            words = f"{drift.real:.3f} + {drift.imag:.3f}j, {share:.3g} % of |Z|"
            parts.append(f"acoustic drift of (A1), of the order of {words}")
        if facts.jet_height is not None:
            side = "above" if facts.height > facts.jet_height else "BELOW"
            reach, speed = f"{1e3 * facts.jet_height:.3g} mm", f"U_j {facts.jet_velocity:.3g} m/s"
            parts.append(f"{side} the jets' height, {reach} (A.2, {speed})")
        lines += [f"{_mm(facts.height)}: {'; '.join(parts)}"] if parts else []
    return lines


def _extrapolated(study: Study, limit: float) -> list[str]:
    """Where the fitted decay of the modulation would meet its limit."""
    decay = study.decay
    if decay is None:
        return []
    sound = 1e3 * study.pitch / (2 * math.pi)
    fitted = f"l = {1e3 * decay.length:.3g} mm (the first harmonic of sound: {sound:.3g} mm)"
    if not decay.follows:
        return [
            f"the cell-periodic modulation does not follow a decay with height: fitted {fitted}, from which the "
            f"heights stray by a factor {decay.scatter:.3g}"
        ]
    reached = math.log(decay.amplitude / limit) / decay.rate
    beyond = "beyond the planes: an extrapolation" if reached > study.facts[-1].height else "fitted"
    return [
        f"the cell-periodic modulation falls as exp(-y/l) with {fitted}; it meets {100 * limit:g} % at "
        f"{_mm(max(reached, 0.0))} ({beyond})"
    ]


def _unknown(study: Study, rows: Sequence[Row]) -> list[str]:
    lines = []
    if any(one.name != "level check" for one in rows):
        lines.append(
            f"{_mm(study.facts[-1].height)} has no plane above it: whether Z has settled there is not known"
            if len(study.facts) > 1
            else "with one height, whether Z has settled cannot be judged; give several planes"
        )
    if any(one.name == "modulation" and one.value is None for one in rows):
        lines.append("the cell-periodic modulation: no cell pitch, or no whole cell under the probes")
    if study.decay is None:
        lines.append("a decay of the modulation with height needs three heights and whole cells")
    return lines


def _mm(height: float) -> str:
    return f"y = {1e3 * height:.3g} mm"
