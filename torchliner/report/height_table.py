"""Height studies as text, as CSV and for JSON."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

from torchliner.report.height_figures import AVERAGINGS, imprint_over_height, length_label
from torchliner.report.table import Column, Table, format_complex, format_pair, real_and_imaginary
from torchliner.studies.rows import Row, Study

FACTS = (
    Column("", "coherence", "coherence", ".2f"),
    Column("", "velocity_rms", "v_rms m/s", ".3f"),
    Column("", lambda one: one.modulation and one.modulation.relative, "modulation v_rms", ".4f"),
    Column("", lambda one: (i := one.modulation) and i.between and i.between / i.mean, "between",
           ".4f"),
    Column("", lambda one: one.streamwise_modulation and one.streamwise_modulation.relative,
           "modulation u_rms", ".4f"),
    Column("", "jet_velocity", "U_j m/s", ".1f"),
    Column("", "jet_height", "H_j mm", ".2f", 1e3),
)  # fmt: skip


def _of(name: str, averaging: str) -> Callable[[Row], Any]:
    """The entry of one averaging in a mapping."""
    return lambda one: one[name].get(averaging)


def facts_table(facts: Sequence[Row]) -> Table:
    """Z of the whole plane and level check by averaging, and what else is known."""
    names = list(facts[0].impedance)
    values = [Column("", _of("impedance", name), name, format_complex) for name in names]
    checked = names if facts[0].level_check else []
    gaps = [Column("", _of("level_check", name), f"level check dB, {name}", "+.2f") for name in checked]
    return Table(facts, [Column("", "height", "y mm", ".2f", 1e3), *values, *gaps, *FACTS])


def height_table(study: Study) -> Table:
    """One row per height and averaging length, with the facts of the height in CSV and JSON."""
    facts = {one.height: one for one in study.facts}
    pitch = study.pitch
    columns = [
        Column("height (m)", "height", "y mm", ".2f", 1e3),
        Column("averaging length (m)", "length", "length", lambda each: length_label(each, pitch)),
        Column("length in cells", lambda row: None if pitch is None else row["length"] / pitch),
        Column("probes", heading="probes", text="d"),
        Column("windows", heading="windows", text="d"),
    ]
    for name, heading in AVERAGINGS.items():
        spread = f"{name}_spread"
        columns += [
            *real_and_imaginary(f"resistance, {name}", f"reactance, {name}", name),
            *real_and_imaginary(f"spread of R, {name}", f"spread of X, {name}", spread),
            Column("", name, heading, format_complex),
            Column("", spread, "spread", format_pair),
        ]
    columns += [
        Column("coherence"),
        Column("v' rms (m/s)", "velocity_rms"),
        Column("modulation of v'", lambda row: row["modulation"] and row["modulation"].relative),
        Column("jet velocity (m/s)", "jet_velocity"),
        Column("jet height (m)", "jet_height"),
    ]
    rows = [facts[row.height] | row for row in study.rows]
    return Table(rows, columns, csv=".9g")


def plain_study(study: Study, found: Study) -> dict[str, Any]:
    """For JSON."""
    imprint, decay, first = imprint_over_height(study), study.decay, study.first_decay
    columns = {imprint.variable: imprint.at, **imprint.values}
    return {
        "title": study.title,
        "frequency": study.frequency,
        "cell_pitch": study.pitch,
        "rows": height_table(study).as_rows(),
        "imprint": {name: values.tolist() for name, values in columns.items()},
        "decay_length": None if decay is None else decay.length,
        "first_harmonic_decay_length": None if first is None else first.length,
        "evanescent_length": None if decay is None else decay.evanescent,
        "recommended_height": found.height,
        "recommended_heights": found.heights,
        "heights": [
            {"height": one.height, "impedance": dict(one.impedance), "level_check": dict(one.level_check)}
            for one in study.facts
        ],
        "judgements": found.rows,
        "reasons": found.reasons,
        "unknown": found.unknown,
        "reference": study.reference,
        "choices": study.choices,
        "notes": study.notes,
    }


def format_study(study: Study, found: Study) -> str:
    """Rows, facts, and which height."""
    lines = [
        f"{study.title}, {study.frequency:g} Hz; Z is p/(rho c v), exp(+jwt); spread: standard "
        "deviation of R and X over windows",
        height_table(study).as_text(),
        f"\nwhole plane\n{facts_table(study.facts).as_text()}",
    ]
    if study.first_decay is not None:
        first = study.first_decay
        lines.append(
            f"first harmonic of v_rms: exp(-y/l), l = {1e3 * first.length:.3g} mm (sound: "
            f"{1e3 * first.evanescent:.3g} mm); heights stray from it by a factor "
            f"{first.scatter:.3g}"
        )
    lines += ["", *found.reasons, *(f"not judged: {line}" for line in found.unknown)]
    for name, value in study.reference.items():
        lines.append(f"not used above: {name} {format_complex(value)}")
    return "\n".join(lines)
