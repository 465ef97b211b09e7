r"""From moments to what the phase rules take: lines of the reflected tone at any frequency.

With the window :math:`w = \sum_q c_q e^{2\pi jqk/N}` over N samples the line f of the reply to
:math:`e^{j\omega t}` is :math:`\sum_q c_q \sum_k e^{2\pi jqk/N} R(f - q f_s/N, |v_k|)`, that of the
reply to :math:`e^{-j\omega t}` has :math:`e^{-2j\omega t_k}` beside. With weight 1 over whole
periods, the default, q is 0 alone.
"""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.reduction.basis import Basis, Response
from torchliner.reduction.plan import PassPlan, index_of, merged
from torchliner.reduction.speed_sums import GroupMoments
from torchliner.signals.windows import Window


def window_lines(window: Window, start: int, sampling_rate: float) -> list[tuple[float, complex]]:
    """Hz and coefficient, phase counted from sample 0, of each wave of which a window is made.

    Raises:
        ValueError: a window that is no sum of few cosines.
    """
    if not window.lines:
        raise ValueError(
            f"window {window.name!r} is no sum of few cosines over {len(window.weights)} samples, "
            "which alone engine 'spectral' weighs exactly; choose 'hann', 'hamming', 'blackman', "
            "'boxcar' or another such, or engine='unfold'"
        )
    step = 1 / len(window.weights)
    turn = torch.exp(-2j * torch.pi * torch.tensor(step * start, dtype=torch.float64))
    return [(q * step * sampling_rate, c * complex(turn) ** q) for q, c in window.lines]


def lines_needed(window: list[tuple[float, complex]], turns: Tensor) -> tuple[float, ...]:
    """Rows that a pass has to sum, Hz, for a window and the turns of a phase rule, (F, Q)."""
    found = [line for line, _ in window]
    found += [turn - line for turn in turns.flatten().tolist() for line, _ in window]
    return merged(found)


class LineReader:
    """Lines at some frequencies (Hz) of a liner, from the moments of any columns.

    Args:
        plan, basis: of the moments.
        window: its lines, of ``window_lines``.
        frequency: Hz, (F,).
        response: R of frequency and |v|.
        turns: Hz, waves e^{-2 pi j turn t} beside R(f), of the phase rule, (F, Q).
    """

    def __init__(
        self, plan: PassPlan, basis: Basis, window: list[tuple[float, complex]],
        frequency: Tensor, response: Response, turns: Tensor,
    ) -> None:  # fmt: skip
        self.plan, self.basis, self.window, self.turns = plan, basis, window, turns
        self.frequency, self.response = frequency, response
        shift = torch.tensor([line for line, _ in window], dtype=torch.float64)
        self.read = frequency[:, None] - shift  # Hz, where R is asked for, (F, lines)
        if float(self.read.min()) <= 0:
            raise ValueError(
                f"the window's lines reach down to {float(self.read.min()):g} Hz around "
                f"{float(frequency.min()):g} Hz; take a longer record, or leave window out"
            )
        values = response(self.read.flatten(), basis.speeds)
        self.coefficients = basis.coefficients(values).unflatten(0, self.read.shape)
        for line in lines_needed(window, turns):
            if index_of(plan.lines, line) is None:
                there = ", ".join(f"{each:.6g} Hz" for each in plan.lines) or "none"
                raise ValueError(
                    f"the moments hold no sums of waves of {line:.9g} Hz, which the phase rule or "
                    f"the window needs (there are: {there}); reduce the data again with that phase "
                    "rule, frequency and window, or choose phase='averaged'"
                )

    def of(self, response: Response) -> LineReader:
        """The same of another response."""
        return LineReader(self.plan, self.basis, self.window, self.frequency, response, self.turns)

    def weights(self, group: GroupMoments) -> Tensor:
        """Of R at ``read`` less ``frequency`` and at the basis' speeds in ``forward``, complex128,
        (lines, K, P); the same ones at each frequency and for each response."""
        rows = []
        for line, c in self.window:
            real, imaginary = self._moment(group.totals, -line)
            sums = torch.complex(real, torch.zeros_like(real) if imaginary is None else imaginary)
            rows.append(c * self.basis.weights(sums))
        return torch.stack(rows)

    def _moment(self, sums: Tensor, line: float) -> tuple[Tensor, Tensor | None]:
        """Real and imaginary part of the sums of T_k e^{-2 pi j line t}, (..., K, P) each."""
        place = index_of(self.plan.lines, abs(line)) if line else None
        if place is None:
            return sums[..., 0, :, :], None
        sign = -1.0 if line > 0 else 1.0
        count = len(self.plan.lines)
        return sums[..., 1 + place, :, :], sign * sums[..., 1 + count + place, :, :]

    def _sum(self, sums: Tensor, parts: list[tuple[Tensor, float]]) -> Tensor:
        """sum over parts of c_k times the moment at a line, (P, F or 1)."""
        total: Tensor | None = None
        for coefficients, line in parts:
            real, imaginary = self._moment(sums, line)
            found = _product(coefficients, real)
            if imaginary is not None:
                found = found + 1j * _product(coefficients, imaginary)
            total = found if total is None else total + found
        assert total is not None
        return total

    def forward(self, group: GroupMoments) -> Tensor:
        """Lines of the reply to e^{j omega t}, complex128, (P, F)."""
        parts = [(c * self.coefficients[:, i], -line) for i, (line, c) in enumerate(self.window)]
        return self._sum(group.totals, parts)

    def turned(self, group: GroupMoments) -> Tensor:
        """Sums of R e^{-2 pi j turn t}; of 2 f, lines of the reply to e^{-j omega t}: (P, F, Q)."""
        found = [
            self._sum(
                group.totals,
                [(c * self.coefficients[f : f + 1, i], turn - line)
                 for i, (line, c) in enumerate(self.window)],
            )
            for f, own in enumerate(self.turns.tolist()) for turn in own
        ]  # fmt: skip
        return self._on_turns(found, group.totals.new_zeros(group.totals.shape[-1], 0))

    def _on_turns(self, found: list[Tensor], none: Tensor) -> Tensor:
        """(..., F, Q) of (..., 1) each."""
        both = torch.cat(found, dim=-1) if found else none
        return both.unflatten(-1, self.turns.shape) if found else both[..., None, :]

    def of_blocks(self, group: GroupMoments) -> tuple[Tensor, Tensor] | None:
        """Means of R, (S, P, F), and of R e^{-2 pi j turn t}, (S, P, F, Q), over each block; None
        without blocks."""
        if group.of_blocks is None:
            return None
        sums = group.of_blocks[: self.plan.rest]
        lengths = self.plan.blocks.lengths.to(sums.device)[:, None, None]
        middle = next(i for i, (line, _) in enumerate(self.window) if line == 0)
        own = self.coefficients[:, middle].detach()

        def means(coefficients: Tensor, line: float) -> Tensor:
            real, imaginary = self._moment(sums, line)
            found = _block_means(coefficients, real, lengths)
            if imaginary is not None:
                found = found + 1j * _block_means(coefficients, imaginary, lengths)
            return found

        forward = means(own, 0.0)
        turned = [means(own[f : f + 1], turn) for f, each in enumerate(self.turns.tolist()) for turn in each]
        return forward, self._on_turns(turned, forward[..., :0])


def _block_means(coefficients: Tensor, sums: Tensor, lengths: Tensor) -> Tensor:
    """c_k, complex, (F, K), times real moments of blocks, (S, K, P), over their lengths, (S, 1, 1);
    the product in the precision of the moments: complex128, (S, P, F)."""
    parts = torch.view_as_real(coefficients.resolve_conj()).transpose(1, 2).flatten(0, 1)  # (2F, K)
    found = ((parts.to(sums) @ sums) / lengths).transpose(1, 2).contiguous()
    return torch.view_as_complex(found.unflatten(2, (-1, 2)))


def _product(coefficients: Tensor, sums: Tensor) -> Tensor:
    """c_k, complex, (F, K), times real moments, (K, P): (P, F)."""
    coefficients = coefficients.to(sums.device)
    wide = sums.T.to(torch.float64)
    return torch.complex(wide @ coefficients.real.T, wide @ coefficients.imag.T)
