"""The answer of impedance maps, one or several that belong together, and its pictures."""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import torch

from torchliner.records import ImpedanceMap, VelocityPlane
from torchliner.records.level_check import FAILS, INCONCLUSIVE, PASSES
from torchliner.report import curves
from torchliner.report.answer import Answer, Grid, Picture, impedance_words
from torchliner.report.maps import case_title, draw_map, family, interval_words, labels_of, over_surface, probe_rows
from torchliner.report.studies import draw_comparison, draw_over_height
from torchliner.report.table import STATISTICAL, Row, table_of
from torchliner.studies.compare import compare
from torchliner.studies.variants import rows_of

MATCHED = "level-matched"
SHOWN = "run,frequency,averaging,impedance,interval,level check,share,spread,coherence"
CELLS = "cell,x,z,frequency,impedance,interval,level_check"


def of_maps(*results: ImpedanceMap, planes: Sequence[VelocityPlane] = ()) -> Answer:
    """Z with its interval and level check, a row a run and frequency; all averagings; what is known from elsewhere;
    pictures of maps at the same frequencies, of the velocity of ``planes`` too."""
    first, several, main = results[0], len(results) > 1, main_of(results[0])
    runs = list(zip(results, labels_of(results), strict=True))
    rows = [{"run": label} | row for one, label in runs for row in map_rows(one)]
    answers = [row for row in rows if row["averaging"] in (first.averaging, MATCHED)]
    lines = [f"Level check: {one.level_check_words}." for one in results]
    if not several:
        lines = [_line(first, main), level_line(first, main)]
    places = [(one, i) for one in results for i in ([main] if not several else range(len(one.frequency)))]
    worst = {state_of(*place): place for place in reversed(places)}
    state = next((word for word in (FAILS, INCONCLUSIVE, PASSES) if word in worst), "")
    name = case_title(first) if several else first.title
    groups = dict[tuple[float, ...], list[int]]()
    for i, one in enumerate(results):
        groups.setdefault(tuple(one.frequency.tolist()), []).append(i)
    pictures = [
        each._replace(name=f"{key[0]:g}Hz_{each.name}" if len(groups) > 1 else each.name)
        for key, own in groups.items()
        for each in _pictures([results[i] for i in own], [planes[i] for i in own if planes])
    ]
    return Answer(
        title=("Impedance map" + "s" * several) + (f": {name}" if name else ""),
        lines=[*dict.fromkeys([*lines, *(line for one in results for line in _known_lines(one))])],
        table=table_of(rows, SHOWN if several else SHOWN.removeprefix("run,")),
        brief=answers if several or len(answers) > 1 else [],
        caption="Z = R + jX of the whole liner over ρc, by averaging, and independent values; the "
        f"interval is {STATISTICAL}; the spread is that over probes and is no uncertainty.",
        grids=[Grid(f"cells{i or ''}", "Each cell.", table_of(_cells(one), CELLS)) for i, one in enumerate(results)],
        notes=[
            note for one in results for notes in (one.notes, *(each.notes for each in one.alongside)) for note in notes
        ],
        step=_step(*worst.get(state, (first, main)), state),
        state=state,
        pictures=pictures,
        results=[each for one in results for each in (one, *one.alongside)],
    )


def main_of(result: ImpedanceMap) -> int:
    """Index of the frequency of the data's tone, else of that at which v is most coherent."""
    if result.tone is not None:
        return result.tone
    coherence = result.coherence.reshape(-1, len(result.frequency))
    return int(coherence.nanmedian(0).values.nan_to_num(-1).argmax())


def map_rows(result: ImpedanceMap) -> list[Row]:
    """A row a frequency and averaging, the answer's first, then level-matched and known impedances."""
    check, matched, rows = result.level_check, result.level_matched, list[Row]()
    flat = result.coherence.reshape(-1, len(result.frequency))
    for i, frequency in enumerate(result.frequency.tolist()):
        about: Row = {"height": result.height, "frequency": frequency}
        for name in sorted(result.averagings, key=lambda each: each != result.averaging):
            low, high = result.bounds_of_liner(name, i) or (None, None)
            row: Row = {"averaging": name, "impedance": complex(result.liner[name].impedance[i])}
            row |= {"low": low, "high": high, "spread": complex(result.liner_spread[i])}
            # The median over probes: a mean of complex waves would cancel along a grazing one.
            row |= {"incident_level": float(result.inferred_incident_level[..., i].nanmedian())}
            row |= {"coherence": float(flat[:, i].nanmedian())}
            if check is not None:
                row |= {"level check": check.words(name, i), "verdict": check.verdict(name, i)}
                row |= check.liner.at(check.averagings.index(name), i)
            rows.append(about | row)
        if matched is not None and bool(matched.share[i].isfinite()):
            names = ("impedance", "low", "high", "share")
            rows.append(about | {"averaging": MATCHED} | {name: getattr(matched, name)[i].tolist() for name in names})
        for name, (z, bounds) in curves.known_of(result, i).items():
            low, high = bounds or (None, None)
            rows.append(about | {"averaging": name, "impedance": z, "low": low, "high": high})
    return rows


def _line(result: ImpedanceMap, index: int) -> str:
    """Z of the liner and its interval."""
    value, at = complex(result.answer[index]), f"at {float(result.frequency[index]):g} Hz"
    if value != value:
        return f"No impedance {at}: every probe counts as wall or was left out."
    bounds = result.bounds_of_liner(result.averaging, index)
    what = "null test of a hard wall, no impedance" if result.choices.get("surface") == "hard wall" else "whole liner"
    end = ", no interval" if bounds is None else f"; the interval is {STATISTICAL}"
    words = impedance_words(value, bounds, result.level)
    return f"{words} in units of ρc {at}, {what}, averaging {result.averaging}{end}."


def level_line(result: ImpedanceMap, index: int) -> str:
    """'Level check fails: -1.93 dB off ...', or why there is none."""
    check, verdict = result.level_check, state_of(result, index)
    if check is None or not verdict:
        return f"Level check: {result.level_check_words if check is None else 'no pressure is known there'}."
    level = check.words(check.averaging, index).removesuffix(verdict).strip()
    return f"Level check {'is ' * (verdict == INCONCLUSIVE)}{verdict}: {level} {result.level_check_words}."


def state_of(result: ImpedanceMap, index: int) -> str:
    """Of the level check of the answer; "" without one."""
    check = result.level_check
    return "" if check is None else check.verdict(check.averaging, index)


def _known_lines(result: ImpedanceMap) -> list[str]:
    """The turbulence that acted, or how it compares with the tone."""
    if background := background_words(result.choices):
        return [f"{background[:1].upper()}{background[1:]}."]
    ratio = result.choices.get("velocity_ratio")
    return [] if ratio is None else [f"Velocity ratio |V1|/(φ M c) = {ratio:.2g}."]


def _step(result: ImpedanceMap, index: int, state: str) -> str:
    """What to do next."""
    check = result.level_check
    if result.choices.get("surface") == "hard wall":
        return ""
    if check is None or not state:
        return "check the level: state incident_level, or give wall pressures (--wall-pressure)"
    if state == FAILS:
        if others := [name for name in check.averagings if check.verdict(name, index) == PASSES]:
            return f"averaging {' and '.join(others)} passes the level check: take it"
        quiet = "" if result.choices.get("background") else "give a run without sound (--background), "
        return f"no averaging passes: {quiet}calibrate the model, check the level, or take another height"
    if state == INCONCLUSIVE:
        return "take a longer record"
    return "torchliner audit shows how far each open choice moves Z"


def _cells(result: ImpedanceMap) -> list[Row]:
    """Each cell: Z in the averaging of the answer, its interval, its level check."""
    found, check, x = result.cells[result.averaging], result.level_check, result.cell_x[:, None]
    return rows_of(
        cell=torch.arange(len(x))[:, None],
        x=x,
        z=result.cell_z[:, None],
        frequency=result.frequency,
        impedance=found.impedance,
        interval=found.interval,
        level_check=None if check is None else check.cells.level[check.averagings.index(result.averaging)],
    )


def _pictures(results: Sequence[ImpedanceMap], planes: Sequence[VelocityPlane]) -> list[Picture]:
    """At the tone, and over frequency where there are several; of two heights and of two runs how they differ."""
    first, runs, found = results[0], list(zip(results, labels_of(results), strict=True)), list[Picture]()
    main = main_of(first)
    at, maps = f"{float(first.frequency[main]):g} Hz", [run for run in runs if over_surface(run[0])]
    bars = f"; bands and bars: {interval_words(first)}" if first.level is not None else ""

    def add(name: str, caption: str, draw: Callable[..., Any], rows: Callable[[Any], Any], of: Any = runs) -> None:
        found.append(Picture(name, caption, draw, lambda: [{"run": k} | row for one, k in of for row in rows(one)]))

    if first.mean_velocity.numel() > 1:
        words = f"Impedance along x at {at}, the admittance averaged over z{bars}."
        draw = partial(curves.draw_along_x, results, frequency_index=main)
        add("along_x", words, draw, partial(curves.impedance_along_x, frequency_index=main))
    if len(first.frequency) > 1:
        words = f"Impedance of the whole liner over frequency{bars}. The axes end before poles of Z."
        add("spectrum", words, partial(curves.draw_spectrum, results), curves.impedance_over_frequency)
    for i, (one, name) in enumerate(maps):
        words = f"{name}: R and X over ρc at each probe, {at}; colours from the 1st to the 99th percentile."
        draw = partial(draw_map, one, frequency_index=main)
        add(f"map{i or ''}", words, draw, partial(probe_rows, index=main), [(one, name)])
    if len({one.height for one in results} - {None}) > 1:
        placed = [run for run in runs if run[0].height is not None]
        known = {name: z for one in results for name, (z, _) in curves.known_of(one, main).items()}
        drawn = [row for one, _ in placed for row in height_rows(one, main)]
        draw = partial(draw_over_height, drawn, family(results, main), references=known)
        add("height", f"Impedance over height at {at}{bars}.", draw, partial(height_rows, index=main), placed)
    if len(results) == 2:
        with contextlib.suppress(ValueError):  # other cells or averagings have no difference
            both = compare(results[0], results[1])
            draw = partial(draw_comparison, both, frequency=float(first.frequency[main]))
            found.append(Picture("difference", "Second minus first.", draw, lambda: both.rows))
    if planes:
        pairs = list(zip(planes, labels_of(planes), strict=True))
        words = "Mean and rms of the velocity along x."
        add("velocity", words, partial(curves.draw_velocity, planes), curves.velocity_along_x, pairs)
    return found


def height_rows(result: ImpedanceMap, index: int) -> list[Row]:
    """Z of the whole liner in each averaging, at the map's height."""
    return [
        {"height": result.height, "averaging": name, "impedance": complex(result.liner[name].impedance[index])}
        | dict(zip(("low", "high"), result.bounds_of_liner(name, index) or (None, None), strict=True))
        for name in result.averagings
    ]


def background_words(choices: Mapping[str, Any]) -> str:
    """'incoherent velocity scaled by 0.43 to 1.38 m/s ...': what a result says of its background; "" without one."""
    found = choices.get("background")
    if found is None:
        return ""
    stated = isinstance(found, float | int)
    rms = [found] if stated else found["rms"]
    ends = " to ".join(dict.fromkeys(f"{end:.3g}" for end in (min(rms), max(rms))))
    source = "as stated" if stated else f"the rms without sound of {' and '.join(found['source'])}"
    return f"incoherent velocity scaled by {choices.get('incoherent_scale', 1.0):.3g} to {ends} m/s, {source}"
