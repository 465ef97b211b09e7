"""Many ways of asking one plane for its impedance: each is a variant, and all share the readings of the data.

Moments of |v| serve every liner, frequency and phase rule, half of the record and half of the sampling rate. Other
|v|, which are another drive, mean or averaging length, share one more reading.
"""

from __future__ import annotations

import dataclasses
import functools
import math
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass
from typing import Any, cast

import torch
from torch import Tensor

from torchliner.conversions import mean_impedance
from torchliner.engine.drives import Drive
from torchliner.engine.moments import Moments
from torchliner.engine.nodes import choose_nodes
from torchliner.engine.sums import Job, reduce
from torchliner.engine.survey import Membership
from torchliner.liners.model import LinerModel
from torchliner.records import VelocityPlane
from torchliner.records.boxes import Windows
from torchliner.studies.rows import Row
from torchliner.velocity.answer import require_fitting
from torchliner.velocity.averages import Asked, Averages, average
from torchliner.velocity.choices import Choices
from torchliner.velocity.known_pressure import KnownPressure, known_pressure
from torchliner.velocity.level_check import ratio_of_pressures
from torchliner.velocity.reading import SURVEY, Progress, Reading, reading_of, take_moments

Records = VelocityPlane | Moments


@dataclass(frozen=True, eq=False)
class Variant:
    """One way of asking for Z.

    Args:
        labels: of its row.
        averaging: of the value.
        chosen: all choices.
        liner: default that of the plane.
        moments: that are asked; default those of the plane, with the drive and mean of ``chosen``.
        psi: rad, phase of the incident sound at all probes, for phase ``given``.
        windows: over which v is averaged in place of the cells, with averaging ``velocity``.
    """

    labels: dict[str, Any]
    averaging: str
    chosen: Choices
    liner: LinerModel | None = None
    moments: Moments | None = None
    psi: float | None = None
    windows: Windows | None = None

    def averages(self, known: Moments, liner: LinerModel, frequency: Tensor) -> Averages:
        """R of cells and liner, from moments."""
        phase = None if self.psi is None else torch.full((known.plane.probes, 1), self.psi, dtype=torch.float64)
        with torch.no_grad():
            return average(known, Asked.of(known, self.liner or liner, frequency, self.chosen, phase), self.averaging)

    @property
    def speed(self) -> tuple[Any, ...]:
        """What makes its |v|."""
        return self.chosen.drive, self.chosen.mean, self.chosen.running_window, self.windows


class Source:
    """A plane that is read for many variants, or the moments of one.

    Args:
        record: wall-normal velocity, or moments.
        liners: that will be asked for; the first is the plane's own, whose cells are averaged over.
        frequency: Hz, one or several; default the tone.
        chosen: all choices of the base.
        more_turns: of the frequencies (F,), waves in Hz that the sums are weighed with beside those of the phase rule.
        progress: called with numbers of samples read.
    Raises:
        ValueError: as ``educe``.
    """

    def __init__(
        self,
        record: Records,
        liners: Sequence[LinerModel],
        frequency: Tensor | float | None,
        chosen: Choices,
        *,
        more_turns: Callable[[Tensor], Iterable[float]] = lambda _: (),
        progress: Progress | None = None,
    ) -> None:
        self.plane, self.liner, self.chosen = plane_of(record), liners[0], chosen
        self.frequency = self.plane.asked(frequency)
        self.progress, self.readings = progress, 0
        self.reading: Reading | None = None
        if isinstance(record, Moments):
            require_fitting(record, self.liner, self.frequency, chosen)
            self.known = record
            return
        self.nodes = choose_nodes(liners, self.frequency, chosen.tolerance(record.velocity.dtype))
        reading = reading_of(record, [], self.frequency, chosen, cell_pitch=self.liner.cell_pitch, nodes=self.nodes)
        turns = torch.cat([reading.turns, torch.tensor([*more_turns(self.frequency)], dtype=torch.float64)])
        reading = dataclasses.replace(reading, turns=turns)
        self.known = take_moments(reading, self._reduce, progress)
        used = self.known.used
        self.reading = reading if bool(used.all()) else reading.without(~used)

    def samples(self) -> Reading:
        """How another |v| is read; ValueError if the samples are not there."""
        if self.reading is None:
            raise ValueError("the time samples are gone: the plane was reduced to moments")
        return self.reading

    def evaluate(self, variants: Sequence[Variant]) -> list[Row]:
        """Z of the whole liner for each variant; those of another |v| share one more reading.

        Returns:
            A row a variant and frequency: its labels, averaging, frequency, impedance (over windows 1/<Y> of those that
            hold a probe), low, high, level_check.
        Raises:
            ValueError: another |v| is asked of moments.
        """
        groups: dict[Any, list[Variant]] = {}
        for each in variants:
            if each.moments is None and not self._is_known(each):
                groups.setdefault(each.speed, []).append(each)
        ways = {speed: self._way(each) for speed, each in groups.items()}
        jobs = [job for _, each, _ in ways.values() for job in each.values()]
        how = (self.samples().record(self.progress), self.samples().blocks, jobs) if jobs or ways else ()
        found = iter(self._reduce(*how) if jobs else [])
        made = {
            speed: reading.moments(self.known.survey, locked, {name: next(found) for name in each})
            for speed, (reading, each, locked) in ways.items()
        }
        asked = [each.moments or made.get(each.speed, self.known) for each in variants]
        return [row for pair in zip(variants, asked, strict=True) for row in self._rows(*pair)]

    def level_of(self, impedance: Tensor) -> list[float | None]:
        """dB by which Z of the whole liner, (F,), and the velocity are off the stated pressure; None if none is."""
        pressure = self._pressure
        if isinstance(pressure, str):
            return [None] * len(impedance)
        ratio = ratio_of_pressures(pressure)(impedance)
        return [level if math.isfinite(level) else None for level in (20 * ratio.abs().log10()).tolist()]

    @functools.cached_property
    def _pressure(self) -> KnownPressure | str:
        return known_pressure(self.known, self.frequency)

    def _is_known(self, variant: Variant) -> bool:
        own = Variant({}, variant.averaging, self.chosen)
        return variant.windows is None and (variant.chosen.drive == "rms" or variant.speed == own.speed)

    def _rows(self, variant: Variant, known: Moments) -> list[Row]:
        found = variant.averages(known, self.liner, self.frequency)
        z, ends = found.liner.impedance.cpu(), found.liner.interval
        if variant.windows is not None:
            over_windows = found.cells.admittance.cpu()
            z = mean_impedance(over_windows[torch.isfinite(over_windows.real).all(1)])
        return [
            Row(
                variant.labels,
                averaging=variant.averaging,
                frequency=float(self.frequency[i]),
                impedance=complex(z[i]),
                **dict(zip(("low", "high"), (None, None) if ends is None else ends.bounds(i), strict=True)),
                level_check=level,
            )
            for i, level in enumerate(self.level_of(z))
        ]

    def _reduce(self, *how: Any) -> list[Tensor]:
        self.readings += 1
        return reduce(*how)

    def _way(self, variants: Sequence[Variant]) -> tuple[Reading, dict[str, Job], Drive | None]:
        """How variants of one |v| are read, what is summed, and the drive of phase-locked averaging."""
        chosen, windows, reading = variants[0].chosen, variants[0].windows, self.samples()
        locked = self.known.locked if "phase-locked" in chosen.averagings else None
        averaged = all(each.chosen.phase == "averaged" for each in variants)
        turns = self.frequency[:0] if averaged else 2 * self.frequency
        reading = dataclasses.replace(reading, chosen=chosen, nodes=self.nodes, turns=turns)
        left_out = {SURVEY} if chosen.drive == "rms" else {SURVEY, "square of cells"}
        if chosen.drive == "rms":
            reading = dataclasses.replace(reading, nodes=None)
        if windows is not None:
            left_out.add("admittance")
            # They have the means and sums of a Membership, which is all that averaging ``velocity`` asks for.
            membership, cells = cast(Membership, windows), dataclasses.replace(reading.cells, weight=None)
            reading = dataclasses.replace(reading, membership=membership, cells=cells)
        jobs = reading.first_jobs() | reading.second_jobs(self.known.survey, locked)
        return reading, {name: job for name, job in jobs.items() if name not in left_out}, locked


def plane_of(record: Records) -> VelocityPlane:
    """What is stated of a plane, or of that which was reduced; TypeError for anything else."""
    if not isinstance(record, Records):
        raise TypeError(f"plane is {type(record).__name__}; a VelocityPlane or Moments is needed")
    return record.plane if isinstance(record, Moments) else record


def of_blocks(known: Moments, part: slice) -> Moments:
    """Moments of some consecutive blocks, with the phase-locked velocity of the whole record."""
    blocks = known.survey.blocks
    first, last = (blocks.periods * i // blocks.count for i in (part.start, part.stop))
    own = dataclasses.replace(blocks, borders=blocks.borders[part.start : part.stop + 1], periods=last - first)
    rows = {name: getattr(known.survey, name)[part] for name in ("sums", "squares", "peaks", "gram")}
    survey = dataclasses.replace(known.survey, blocks=own, **rows)
    return dataclasses.replace(known, survey=survey, sums={name: sums[part] for name, sums in known.sums.items()})


def every_second(known: Moments) -> Moments:
    """Moments of the samples 0, 2, ... alone, whose weight is (1 + (-1)^n)/2: of |v| as it is, for phase ``averaged``.

    Args:
        known: with half the sampling rate among its ``turns``.
    """
    seen, rate = known.survey, known.plane.sampling_rate / 2
    row = 1 + int((known.turns == rate).nonzero()[0])
    gram = seen.gram.clone()
    signs = seen.blocks.wave_sums(torch.tensor([rate]))[:, 0].real
    gram[:, 0, 0] = (gram[:, 0, 0] + signs.to(gram)) / 2
    sums = {n: (v[:, :1] + v[:, row : row + 1]) / 2 for n, v in known.sums.items() if v.shape[1] > 1}
    return dataclasses.replace(known, survey=dataclasses.replace(seen, gram=gram), turns=known.turns[:0], sums=sums)
