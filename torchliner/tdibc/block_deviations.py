r"""First-order deviation of the educed R in each block of the record, under every rule.

With a = <R> and b = <R e^{-2 j omega t}>: averaged R = a; given R = a + b u, u = e^{-2 j psi};
self-consistent the same with psi the argument of N = (1 - a)^* V + b V^*, so that
dR = da + u db - 2 j u b Im(dN/N), dN = -(da)^* V + (1 - a)^* dV + db V^* + b dV^*.
The drive ``rms`` holds |v| constant, so that R moves with the mean square alone.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.replay.block_lines import BlockMeans
from torchliner.replay.incident import Means
from torchliner.replay.kernels import impedance_of
from torchliner.tdibc.prepared import Prepared

RMS_STEP = 1e-4  # of the mean square, relative: the slope errs by 1e-8


class BlockDeviations:
    """Deviation of R of probes and cell averages; computed for some columns at a time."""

    def __init__(
        self, ready: Prepared, sums: BlockMeans | None, rule: str, psi: Tensor | None,
        means: Means, held: Tensor,
    ) -> None:  # fmt: skip
        """``psi``: for ``given``; ``held``: where ``self-consistent`` did not fall back."""
        self.ready, self.sums, self.rule = ready, sums, rule
        self.psi, self.means, self.held = psi, means, held

    def of(self, columns: slice) -> Tensor:
        """dR, complex128, (S, columns, F)."""
        if self.ready.chosen.drive == "rms":
            return self._of_rms(columns)
        assert self.sums is not None
        da = _away(self.sums.forward[:, columns])
        if self.rule == "averaged" or self.means.b is None:
            return da
        assert self.sums.backward is not None
        db = _away(self.sums.backward[:, columns])
        if self.psi is not None:
            return da + db * torch.exp(-2j * self.psi[columns])
        b, held = self.means.b[columns], self.held[columns]
        away, wave = (1 - self.means.a[columns]).conj(), self.ready.velocity_amplitude[columns]
        seen = self.ready.seen.blocks
        assert seen is not None
        dv = -_away(seen.line[:, columns])  # v into the liner is -v
        whole = away * wave + b * wave.conj()
        whole = torch.where(whole == 0, torch.ones_like(whole), whole)  # where the rule fell back
        change = -da.conj() * wave + away * dv + db * wave.conj() + b * dv.conj()
        turn = whole.conj() / whole
        return da + torch.where(held, turn * (db - 2j * b * (change / whole).imag), 0)

    def _of_rms(self, columns: slice) -> Tensor:
        ready = self.ready
        seen = ready.seen.blocks
        assert seen is not None
        square, mean = ready.seen.mean_square[columns], ready.seen.mean[columns]
        change = _away(seen.mean_square[:, columns])
        if ready.chosen.mean == "removed":
            square = square - mean**2
            change = change - 2 * mean * _away(seen.mean[:, columns])
        square = square.clamp(min=0).cpu()
        ends = []
        with torch.no_grad():
            for factor in (1 - RMS_STEP, 1 + RMS_STEP):
                speed = (square * factor).sqrt()
                z = impedance_of(ready.liner, ready.frequency, speed[:, None])
                ends.append((z - 1) / (z + 1))
        slope = (ends[1] - ends[0]) / (2 * RMS_STEP * square.clamp(min=1e-300))[:, None]
        return change[..., None] * slope.to(change.device)


def _away(values: Tensor) -> Tensor:
    """Less the mean over the blocks, in double precision."""
    wide = values.to(torch.complex128 if values.is_complex() else torch.float64)
    return wide - wide.mean(0)
