"""The reference engine: the time-domain sum (3.2), term by term, in float64."""

from __future__ import annotations

import torch
from torch import Tensor

from torchliner.replay.edges import Record
from torchliner.replay.emissions import ComplexTones, Emission
from torchliner.replay.incident import LineSums
from torchliner.replay.kernels import KernelTable
from torchliner.replay.levels import VelocityGrid, interpolate
from torchliner.replay.sinks import ToneSink

PROBES_AT_ONCE = 128


def replay_direct(speed: Tensor, kernels: KernelTable, emission: Emission, record: Record) -> Tensor:
    """Reflected signal of every column for an incident wave.

    Each emission time k adds x_k h[m; |v_k|] at k + m: the kernel belongs to the emission, not to
    the reception. For exp(+j omega t) the wave cos(omega t + psi) gives Re(e^{j psi} y).

    Args:
        speed: |v|, m/s, float64, shape (P, n).
        kernels: impulse responses over |v|.
        emission: incident wave, S channels.
        record: its edge rule says what is emitted outside the record.
    Returns:
        y, complex128 or float64 as the wave, shape (S, P, n).
    Source: Roncen et al. (2026), eq. (3.2), extended to taps before zero.
    """
    parts = [_replay_batch(batch, kernels, emission, record) for batch in speed.to(torch.float64).split(PROBES_AT_ONCE)]
    return torch.cat(parts, dim=1)


def _replay_batch(speed: Tensor, kernels: KernelTable, emission: Emission, record: Record) -> Tensor:
    probes, n = speed.shape
    taps = kernels.taps.to(speed.device)
    length, first = taps.shape[1], kernels.first
    outside = max(0, first + length - 1)
    waves = emission.values(-outside, n - first).to(speed.device)
    # Receptions -K .. n + K - 1, cut or wrapped to the record at the end.
    received = torch.zeros(len(waves), probes, n + 2 * length, dtype=waves.dtype, device=speed.device)

    def emit(k: int, kernel: Tensor) -> None:
        at = k + first + length
        begin, end = max(at, 0), min(at + length, n + 2 * length)
        if begin < end:
            now = waves[:, k + outside]
            received[:, :, begin:end] += now[:, None, None] * kernel[:, begin - at : end - at]

    assert isinstance(kernels.grid, VelocityGrid)  # levels of the data, not nodes of a basis
    index, weights = kernels.grid.locate(speed)
    zone = min(n, length)
    early, late = torch.zeros_like(taps[:1]), torch.zeros_like(taps[:1])
    for k in range(n):
        kernel = interpolate(taps, index[:, k], [weight[:, k] for weight in weights])
        emit(k, kernel)
        if k < zone:
            early = early + kernel / zone
        if k >= n - zone:
            late = late + kernel / zone
    if record.edge == "wrap":
        wrapped = torch.zeros_like(received[:, :, :n])
        where = torch.arange(-length, n + length, device=speed.device) % n
        return wrapped.index_add(2, where, received)
    if record.edge == "finite":
        for k in range(-outside, 0):
            emit(k, early)
        for k in range(n, n - first):
            emit(k, late)
    return received[:, :, length : length + n]


def direct_sums(speed: Tensor, kernels: KernelTable, frequency: Tensor, record: Record) -> LineSums:
    """Windowed lines of the replies to complex tones; see ``incident.LineSums``."""
    tones = ComplexTones(frequency, record.sampling_rate)
    reflected = replay_direct(speed, kernels, tones, record)
    sink = ToneSink(frequency, record, len(speed), speed.device)
    sink.add(torch.cat([reflected.real, reflected.imag]), slice(0, len(speed)), 0)
    return sink.sums(backward=True)
