"""Many ways of asking one plane for its impedance: a study is a list of variants, which one function evaluates.

Moments of |v| serve every liner, frequency and phase rule, half of the record and half of the sampling rate. Other
|v|, which are another drive or mean, share one more reading.
"""

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import torch
from torch import Tensor

from torchliner.engine.moments import Moments
from torchliner.engine.nodes import Nodes, choose_nodes
from torchliner.engine.sums import PlaneRecord, reduce
from torchliner.liners.model import LinerModel
from torchliner.names import resolve
from torchliner.records import VelocityPlane
from torchliner.velocity.averages import Averages, average
from torchliner.velocity.choices import TOLERANCES, Choices
from torchliner.velocity.level_check import known_pressure
from torchliner.velocity.reading import CELLS, Progress, reading_of, take_moments

Records = VelocityPlane | Moments


class Row(dict[str, Any]):
    """Values of one place, choice, model or run by name; ``row.impedance`` is ``row["impedance"]``.

    Shared names: ``impedance``, ``low``, ``high`` (ends of its statistical interval; None without one), complex and
    normalised; ``frequency`` (Hz), ``height`` (m), ``level_check`` (dB off the known pressure; None if unknown).
    """

    def __getattr__(self, name: str) -> Any:
        if name not in self:
            raise AttributeError(f"the row has no {name!r} (it has: {', '.join(self)})")
        return self[name]


def rows_of(**columns: Any) -> list[Any]:
    """A row a value of columns: tensors, arrays and single values (also None) that go together by broadcasting.

    An ``interval``, or None, becomes ``low`` and ``high``.
    """
    if "interval" in columns:
        interval = columns.pop("interval")
        columns |= {end: getattr(interval, end, None) for end in ("low", "high")}
    plain = [value.tolist() if hasattr(value, "tolist") else value for value in columns.values()]
    arrays = np.broadcast_arrays(*(np.asarray(value, dtype=object) for value in plain))
    return [Row(zip(columns, values, strict=True)) for values in zip(*(each.flat for each in arrays), strict=True)]


class Study(Row):
    """A result: ``rows``, and by name what they share."""

    def __repr__(self) -> str:
        return self._shown("screen") or dict.__repr__(self)

    def _repr_html_(self) -> str | None:
        return self._shown("html")

    def _shown(self, outlet: str) -> str | None:
        """As the report shows it; None of a kind of study that it does not know."""
        try:
            return str(getattr(resolve("torchliner.report.answer:answer_of")(self), outlet)())
        except TypeError:
            return None

    def of(self, **labels: Any) -> list[Row]:
        """The rows that have these values, e.g. ``found.of(factor="height")``."""
        return [row for row in self.rows if all(getattr(row, name) == value for name, value in labels.items())]


@dataclass(frozen=True, eq=False)
class Variant:
    """One way of asking for Z of the whole liner.

    Args:
        labels: of its row.
        moments, liner, averaging, chosen: what is asked, for which liner, with all choices.
        psi: rad, phase of the incident sound at all probes, for phase ``given``.
    """

    labels: dict[str, Any]
    moments: Moments
    liner: LinerModel
    averaging: str
    chosen: Choices
    psi: float | None = None

    def averages(self, frequency: Tensor) -> Averages:
        """R of cells and liner; ``frequency`` in Hz, (F,)."""
        with torch.no_grad():
            return average(self.moments, self.liner, frequency, self.chosen, self.averaging, self.psi)


def evaluate(variants: Sequence[Variant], frequency: Tensor, base: Moments) -> list[Row]:
    """A row a variant and frequency: its labels, averaging, frequency, impedance, low, high, level_check.

    ``base`` has the velocity at the tone, for the level check.
    """
    pressure, rows = known_pressure(base, frequency), list[Row]()
    for variant in variants:
        found, levels = variant.averages(frequency).liner.map(Tensor.cpu), None
        if not isinstance(pressure, str):
            decibels = (20 * pressure.ratio(found.impedance[None, None]).abs().log10()).flatten().tolist()
            levels = [each if math.isfinite(each) else None for each in decibels]
        about = {"averaging": variant.averaging, "impedance": found.impedance, "interval": found.interval}
        rows += rows_of(**variant.labels, frequency=frequency, level_check=levels, **about)
    return rows


def plane_of(record: Records) -> VelocityPlane:
    """What is stated of a plane, or of that which was reduced; TypeError for anything else."""
    if not isinstance(record, Records):
        raise TypeError(f"plane is {type(record).__name__}; a VelocityPlane or Moments is needed")
    return record.plane if isinstance(record, Moments) else record


def read_for(
    plane: VelocityPlane,
    liners: Sequence[LinerModel],
    frequency: Tensor,
    chosen: Choices,
    turns: Sequence[float] = (),
    progress: Progress | None = None,
) -> tuple[Moments, Nodes]:
    """Moments of a plane for several liners, in cells of the first one, and the nodes for any further reading.

    ``turns``: Hz, of waves that the sums are weighed with beside those of the phase rule.
    """
    nodes = choose_nodes(liners, frequency, TOLERANCES[chosen.working(plane.velocity)[1]])
    reading = reading_of(plane, [], frequency, chosen, cell_pitch=liners[0].cell_pitch, nodes=nodes)
    reading = dataclasses.replace(reading, turns=torch.cat([reading.turns, reading.turns.new_tensor([*turns])]))
    return take_moments(reading, progress=progress), nodes


def read_again(
    plane: VelocityPlane,
    nodes: Nodes,
    frequency: Tensor,
    variants: Sequence[Variant],
    progress: Progress | None = None,
) -> list[Variant]:
    """Variants of other |v|, with their moments from one more reading; those of the base know drive ``rms`` already."""
    groups: dict[Any, list[Variant]] = {}
    for each in (each for each in variants if each.chosen.drive != "rms"):  # by what makes |v|
        groups.setdefault((each.chosen.drive, each.chosen.mean, each.chosen.running_window), []).append(each)
    ways, jobs = [], []
    for group in groups.values():
        known, chosen = group[0].moments, group[0].chosen
        # The phase-locked drive, with its background, is that of the base.
        phase = next((each.chosen.phase for each in group if each.chosen.phase != "averaged"), "averaged")
        chosen = dataclasses.replace(chosen, phase=phase, background=None)
        way = reading_of(plane, [], frequency, chosen, cell_pitch=known.cell_pitch, nodes=nodes)
        way = dataclasses.replace(way, blocks=known.survey.blocks).without(~known.used)
        possible = way.jobs() | way.jobs(known.survey, known.locked)
        names = [each for each in possible if each in {CELLS, *(variant.averaging for variant in group)}]
        jobs += [possible[name] for name in names]
        ways.append((group, way, names))
    record = PlaneRecord(plane, way.dtype, way.device, way.used, progress)
    sums, found = iter(reduce(record, way.blocks, jobs)), dict[int, Moments]()
    for group, own, names in ways:
        known = group[0].moments
        made = own.moments(known.survey, known.locked, {name: next(sums) for name in names})
        found |= dict.fromkeys(map(id, group), made)
    return [dataclasses.replace(each, moments=found.get(id(each), each.moments)) for each in variants]


def of_blocks(known: Moments, part: slice) -> Moments:
    """Moments of some consecutive blocks, with the phase-locked velocity of the whole record."""
    blocks = known.survey.blocks
    first, last = (blocks.periods * i // blocks.count for i in (part.start, part.stop))
    own = dataclasses.replace(blocks, borders=blocks.borders[part.start : part.stop + 1], periods=last - first)
    rows = {name: getattr(known.survey, name)[part] for name in ("sums", "squares", "peaks", "gram")}
    survey = dataclasses.replace(known.survey, blocks=own, **rows)
    return dataclasses.replace(known, survey=survey, sums={name: sums[part] for name, sums in known.sums.items()})


def every_second(known: Moments) -> Moments:
    """Moments of samples 0, 2, ... alone, whose weight is (1 + (-1)^n)/2; ``known`` has half the sampling rate among
    its ``turns``."""
    seen, rate = known.survey, known.plane.sampling_rate / 2
    row = 1 + int((known.turns == rate).nonzero()[0])
    gram = seen.gram.clone()
    signs = seen.blocks.wave_sums(torch.tensor([rate]))[:, 0].real
    gram[:, 0, 0] = (gram[:, 0, 0] + signs.to(gram)) / 2
    sums = {n: (v[:, :1] + v[:, row : row + 1]) / 2 for n, v in known.sums.items() if v.shape[1] > 1}
    return dataclasses.replace(known, survey=dataclasses.replace(seen, gram=gram), turns=known.turns[:0], sums=sums)
