"""How far each choice that the paper leaves open moves the answer, beside its statistical interval."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any

import torch

from torchliner.checks import require_choice, require_positive, tell
from torchliner.engine.moments import Moments
from torchliner.liners.model import Liner, as_liner
from torchliner.names import AVERAGINGS
from torchliner.records import VelocityPlane
from torchliner.records.same_case import planes_by_height
from torchliner.studies.factors import FACTORS, OTHER_LINERS, Base
from torchliner.studies.reference_cases import nearest_case
from torchliner.studies.rows import Row, Study
from torchliner.studies.variants import Records, Source, Variant, plane_of
from torchliner.velocity.answer import answer
from torchliner.velocity.choices import Choices
from torchliner.velocity.reading import Progress


def audit(
    planes: VelocityPlane | Moments | Sequence[VelocityPlane | Moments],
    liner: Liner,
    frequency: float | None = None,
    *,
    averaging: str = "phase-locked",
    progress: Progress | None = None,
    **choices: Any,
) -> Study:
    """Vary every open choice by itself and see what it does to the impedance of the whole liner.

    Args:
        planes: the plane, or several of one case, of which the first is audited and the others are its other heights.
            What ``Moments`` do not hold is left out, with the reason.
        liner: as for ``educe``.
        frequency: Hz, one; default the plane's own tone.
        averaging: one of ``names.AVERAGINGS``.
        progress: called with numbers of samples read.
        choices: of the base, see ``torchliner.velocity.choices.Choices``; its phase rule is ``averaged``.
    Returns:
        title, frequency (Hz), averaging; base (Z of the whole liner with the choices as they are), low, high, level
        (its interval; None without one), level_check (dB) and level_check_words, choices, notes; nearest_case (what
        came out in the shipped case most like this one, whose impedance is known); readings (how often the velocity was
        read through, over all planes); skipped (factors that cannot be varied with these data, and why). ``rows``, the
        factor that moves Z most first: factor, variant (what was changed, and to what), impedance, change (off the
        base), level_check.
    Raises:
        ValueError: as ``educe``; several frequencies; a choice that an audit varies itself.
    """
    several = [planes] if isinstance(planes, Records) else list(planes)
    for each in several:
        if not isinstance(each, Records):
            raise TypeError(f"planes holds {type(each).__name__}; VelocityPlane is needed")
    if len(several) > 1:
        planes_by_height([plane_of(each) for each in several])
    record, model, plane = several[0], as_liner(liner), plane_of(several[0])
    stated, window = _choices(record, averaging, choices)
    if len(plane.asked(frequency)) != 1:
        raise ValueError(f"an audit has one frequency; {len(plane.asked(frequency))} are given")
    quiet = dataclasses.replace(stated, interval=None)
    skipped: dict[str, str] = {}
    variants: list[Variant] = []
    for factor, others in OTHER_LINERS.items():
        try:
            made = others(model).items()
            variants += [Variant({"factor": factor, "variant": n}, averaging, quiet, each) for n, each in made]
        except ValueError as reason:
            skipped[factor] = str(reason)
    models = [model, *(each.liner for each in variants if each.liner is not None)]
    turns = lambda f: (2 * float(f[0]), plane.sampling_rate / 2)  # noqa: E731
    source = Source(record, models, frequency, stated, more_turns=turns, progress=progress)
    with torch.no_grad():
        found = answer(source.known, model, source.frequency, stated)
    z = found.liner[averaging].impedance
    if not bool(torch.isfinite(z.abs()).all()):
        raise ValueError(
            f"{plane.name}: the base has no admittance, since every probe counts as wall; lower or leave out "
            "wall_filter"
        )
    base = Base(source, averaging, quiet, window, skipped)
    for factor, make in FACTORS.items():
        try:
            variants += make(base)  # those before a reason stay
        except ValueError as reason:
            skipped[factor] = str(reason)
    rows, readings = source.evaluate(variants), source.readings
    if len(several) == 1:
        skipped["height"] = "one plane is given; name the other heights too"
    for other in several[1:]:
        facts = plane_of(other)
        name = facts.name if facts.height is None else f"y = {1e3 * facts.height:.3g} mm"
        above = Source(other, models, frequency, stated, progress=progress)
        rows += above.evaluate([Variant({"factor": "height", "variant": name}, averaging, quiet)])
        readings += above.readings
    rows = [Row(each, change=each.impedance - complex(z[0])) for each in rows]
    size = {row.factor: max(abs(each.change) for each in rows if each.factor == row.factor) for row in rows}
    notes = tuple(note.text for note in found.notes)
    tell(notes)
    low, high = found.bounds_of_liner(averaging) or (None, None)
    return Study(
        title=found.title or plane.name,
        frequency=float(source.frequency[0]),
        averaging=averaging,
        base=complex(z[0]),
        low=low,
        high=high,
        level=found.level,
        level_check=source.level_of(z)[0],
        level_check_words=found.level_check_words,
        rows=tuple(sorted(rows, key=lambda row: (-size[row.factor], row.factor, -abs(row.change)))),
        skipped=skipped,
        readings=readings,
        choices=dict(found.choices),
        nearest_case=nearest_case(found),
        notes=notes,
    )


def _choices(record: Records, averaging: str, choices: dict[str, Any]) -> tuple[Choices, float | None]:
    """Choices of the base, and the averaging length of ``running-rms``, be it of the base or of a variant.

    Raises:
        ValueError: a choice that an audit varies itself, or one that the moments do not hold.
    """
    require_choice("averaging", averaging, AVERAGINGS)
    if choices.get("phase") is not None:
        raise ValueError(
            "phase cannot be chosen for an audit: its base is the phase averaged, and the other rules are among what "
            "it varies"
        )
    window = choices.get("running_window")
    if window is not None:
        require_positive("running_window", window)
    if choices.get("drive") != "running-rms":
        choices = {name: value for name, value in choices.items() if name != "running_window"}
    chosen = Choices(**choices)
    if isinstance(record, Moments):
        chosen = dataclasses.replace(chosen, averaging=record.settings["averaging"])
        require_choice(f"averaging of moments reduced with {chosen.averaging!r}:", averaging, chosen.averagings)
    return chosen, window
