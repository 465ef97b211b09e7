"""Every choice of an eduction in one validated place."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any, Self

import torch

from torchliner.checks import make_plain, one_number, require_choice, require_positive
from torchliner.names import (
    DRIVES,
    DTYPES,
    EDGE_RULES,
    ENGINES,
    KERNELS,
    MEANS,
    MISSING,
    ORDERS,
    PHASE_RULES,
    RESAMPLED,
    RESPONSES,
    did_you_mean,
)
from torchliner.records.slabs import WORK_BYTES, bytes_of
from torchliner.replay.waves import parse_signal

WHOLE_PERIODS = "whole-periods"
NAMED = {
    "engine": ENGINES, "phase": PHASE_RULES, "edge": EDGE_RULES, "drive": DRIVES, "mean": MEANS,
    "kernel": KERNELS, "response": RESPONSES, "missing": MISSING,
    "resample": RESAMPLED, "order": ORDERS,
}  # fmt: skip
CALLED = {"phase": "phase rule", "edge": "edge rule", "order": "order of averaging"}
POSITIVE = ("velocity_max", "running_window", "rank_tolerance", "segment", "oncoming_rms",
            "tolerance")  # fmt: skip
TOLERANCES = {torch.float32: 1e-6, torch.float64: 1e-9}  # of R
PRECISIONS = {name: getattr(torch, name) for name in DTYPES}


@dataclass(frozen=True)
class Choices:
    """What the paper leaves open, and what it does not.

    Args:
        engine: ``spectral`` (fast, tones), ``unfold`` (the whole reflected signal) or ``direct``
            (the literal sum, in float64); ``auto``: ``spectral``, with an incident signal
            ``unfold``.
        incident: signal that is sent at the liner instead of tones: ``Tones``, ``Sweep``,
            ``BandNoise``, ``Recorded``, or text such as "noise:300:6000". R(f) is then the
            H1 estimate, sum Y X* / sum |X|^2 over the segments.
        segment: s of a segment of the estimate, overlapping by half; default the whole record.
        phase: phase of the incident tone relative to v: ``averaged`` (nothing else is known),
            ``self-consistent`` (from v's own part at f), ``given``, or ``joint`` (all frequencies
            asked for are tones of one wave, 5 at most).
        edge: ``finite``, ``wrap`` or ``silent``; see ``torchliner.replay.edges``. ``auto``:
            ``finite``, also with ``Tones``; ``wrap`` with ``Sweep`` and ``BandNoise``, ``silent``
            with ``Recorded``.
        window: ``whole-periods`` (default of ``spectral``): each emission time weighs the same,
            over whole periods of the tone in the data, else of the lowest frequency asked for; or
            a window of scipy, as it acts on the reflected signal: a sum of few cosines for
            ``spectral``, any for the others. Default of these ``hann``; with ``Sweep``,
            ``BandNoise`` and ``Recorded`` over the whole record ``boxcar``.
        drive: |v| that drives the kernel: ``instantaneous``, ``rms`` over the record, or
            ``running-rms`` over ``running_window``.
        mean: time-mean velocity ``kept`` in the drive or ``removed``.
        kernel: ``two-sided`` or ``causal``.
        response: ``model`` (R of the liner itself) or ``kernel`` (that of the impulse responses);
            by default the model's for the two-sided kernel, whose error is reported.
        band: Hz, where the kernel stands for the liner; default 300-3500 Hz, widened to the
            frequencies asked for and to the incident signal's band.
        levels, spacing, interpolation: velocity grid of the kernels' tables, for ``unfold`` and
            ``direct``.
        velocity_max: top of the grid, m/s; default from the whole record, rounded up.
        pre_roll: s at the start of the record that only emit; the window comes after.
        running_window: s; default one period of the lowest frequency.
        minimum_coherence: squared coherence of v with the tone below which ``self-consistent``
            falls back to ``averaged``; without a tone 0.5 is passed in 1 of 128 with 8 segments
            of two periods, in 1 of 2 with 2 (then noted).
        wall_filter: squared coherence of v with the tone, 0 to 1, below which a probe counts as
            wall: admittance 0 in the averages over probes (section 7.2). Its own value stays, and
            the averages with velocity first are not touched. Default off.
        missing: probes holding nan or inf: ``refuse`` the plane or ``exclude`` them.
        allow_short: accept fewer than four periods.
        device, dtype: where and in what precision R is evaluated; default those of the data.
        memory: bytes, or text such as "2GB", for slabs and work arrays; what the program itself
            (some 0.4 GB) and the result (some 200 B a probe and frequency) take comes on top.
            Default: what is fast, about 0.2 GB, for ``unfold`` 1 GB.
        interval: level of the statistical intervals, 0 to 1; None for no intervals.
            Available for tones only.
        resample: what is resampled for the whole liner: ``time``, ``time-span`` (and rows along
            z: whole cells, else rows of probes) or ``time-cells`` (and cells, as if independent).
        order: of averaging, which gives the map's ``answer``. ``coherent first`` (the default for
            tones): what of v is periodic with the tone is averaged over the cell, the rest drives
            each probe where it is; ``velocity first``: all of v over the cell; ``probes first``
            (the paper, and the default with an incident signal): nothing. The first takes another
            replay of every probe and is left out where one of the others is asked for.
        closure_limit: dB that Z and the coherent velocity may be off a known pressure.
        level_doubt: dB by which that pressure is itself doubtful; adds to the limit.
        oncoming_rms: of ``coherent first``: rms of the turbulence that comes to the liner, m/s, as
            a run without sound has it at the same height; the incoherent velocity of each cell is
            brought down to it. For strong sound in weak flow, whose jets leave debris above the
            liner that is no oncoming turbulence. Default: as measured.
        tolerance: error in R at each |v| allowed to its interpolation over |v|, in ``spectral``
            and in error bars; default 1e-6 in float32, 1e-9 in float64. The result states it.
        rank_tolerance: error in R allowed to the low-rank factors of ``unfold``'s kernels;
            default 5e-6 in float32, 3e-11 in float64.
    """

    engine: str = "auto"
    phase: str = "averaged"
    edge: str = "auto"
    window: Any = None
    drive: str = "instantaneous"
    mean: str = "kept"
    kernel: str = "two-sided"
    response: str | None = None
    band: tuple[float, float] | None = None
    levels: int = 200
    spacing: str = "sqrt"
    interpolation: str = "cubic"
    velocity_max: float | None = None
    pre_roll: float = 0.0
    running_window: float | None = None
    minimum_coherence: float = 0.5
    missing: str = "refuse"
    allow_short: bool = False
    device: str | torch.device | None = None
    dtype: str | torch.dtype | None = None
    memory: int | str | None = None
    tolerance: float | None = None
    rank_tolerance: float | None = None
    incident: Any = None
    segment: float | None = None
    interval: float | None = 0.95
    resample: str = "time"
    wall_filter: float | None = None
    order: str = "auto"
    oncoming_rms: float | None = None
    closure_limit: float = 0.3
    level_doubt: float = 0.0

    def __new__(cls, *_: Any, **choices: Any) -> Self:
        """Names alone are looked at here, so that a slip of one is told with what was meant.

        Raises:
            TypeError: a name that is no choice.
        """
        known = [*cls.__dataclass_fields__, "frequency", "reflected", "progress"]
        for name in choices:
            if name not in cls.__dataclass_fields__:
                raise TypeError(f"no option is called {name!r}{did_you_mean(name, known)}")
        return super().__new__(cls)

    def __post_init__(self) -> None:
        make_plain(self)
        self._fill_in()
        for name, known in NAMED.items():
            if name != "response" or self.response is not None:
                require_choice(CALLED.get(name, name), getattr(self, name), known)
        if self.response == "model" and (self.kernel == "causal" or self.engine != "spectral"):
            raise ValueError(
                f"response='model' bypasses the kernel, which engine={self.engine!r}, "
                f"kernel={self.kernel!r} ask for; leave response out"
            )
        if not 0 <= self.pre_roll < float("inf"):
            raise ValueError(f"pre_roll is {self.pre_roll:g} s; it is at least 0")
        if self.pre_roll and self.edge == "wrap":
            raise ValueError("edge rule 'wrap' has no pre_roll: a periodic record has no start")
        for name in POSITIVE:
            if getattr(self, name) is not None:
                require_positive(name, getattr(self, name))
        if self.engine == "spectral" and self.edge == "silent":
            raise ValueError(
                "edge rule 'silent' needs the reflected signal; engine 'spectral' weighs emission "
                "times, where no reply is lost: leave edge out, or choose engine='unfold'"
            )
        if self.engine != "spectral" and self.whole_periods:
            raise ValueError(
                f"window {WHOLE_PERIODS!r} weighs emission times, which engine 'spectral' does; "
                "leave it out, or choose 'hann' or 'boxcar'"
            )
        for name in ("minimum_coherence", "wall_filter"):
            value = getattr(self, name)
            if value is not None and not 0 <= value <= 1:
                raise ValueError(f"{name} is {value:g}; it is a squared coherence, 0 to 1")
        for name in ("closure_limit", "level_doubt"):
            if not 0 <= getattr(self, name) < float("inf"):
                raise ValueError(f"{name} is {getattr(self, name):g} dB; it is at least 0")
        self._check_band()
        self._check_resampling()
        self.memory_bytes  # noqa: B018  checked here
        self.working_device(torch.device("cpu"))
        self.working_dtype(torch.float64)

    def _check_band(self) -> None:
        if self.band is None:
            return
        try:
            low, high = (one_number("band (Hz)", edge) for edge in self.band)
        except (TypeError, ValueError):
            raise TypeError(
                f"band is {self.band!r}; give its lowest and its highest frequency in Hz, as (300, 3500)"
            ) from None
        object.__setattr__(self, "band", (low, high))

    def _check_resampling(self) -> None:
        if self.interval is None:
            return
        require_positive("interval", self.interval)
        if self.interval >= 1:
            raise ValueError(f"interval is {self.interval:g}; it is a level between 0 and 1")

    def _fill_in(self) -> None:
        """Defaults that depend on the incident signal, and what does not go with one."""
        wave = self.incident
        if isinstance(wave, str):
            wave = parse_signal(wave)
            if wave is None:
                raise ValueError(
                    f"incident signal {self.incident!r} is no generated one; read a file with torchliner.read_signal"
                )
            object.__setattr__(self, "incident", wave)
        if wave is not None and not hasattr(wave, "sampled"):
            raise TypeError(f"incident is {type(wave).__name__}; wrap your samples as Recorded(signal, rate)")
        for wrong, reason in (
            (wave is not None and self.engine == "spectral",
             "engine 'spectral' replays tones; an incident signal needs 'unfold' or 'direct'"),
            (wave is not None and self.phase != "averaged",
             f"phase {self.phase!r} is a rule for tones; an incident signal has its own phase"),
            (wave is not None and self.wall_filter is not None,
             "wall_filter asks for the coherence of v with a tone; with an incident signal there "
             "is none, leave it out"),
            (wave is None and self.segment is not None,
             "segment is only used with an incident signal"),
            (wave is not None and self.order == ORDERS[2],
             f"order {ORDERS[2]!r} takes v apart by a tone; an incident signal is none"),
            (self.oncoming_rms is not None
             and (wave is not None or self.order not in ("auto", ORDERS[2])),
             f"oncoming_rms is only used with order {ORDERS[2]!r}"),
            (self.running_window is not None and self.drive != "running-rms",
             f"running_window is only used with drive='running-rms', not {self.drive!r}"),
        ):  # fmt: skip
            if wrong:
                raise ValueError(reason)
        defaults = {
            "engine": "spectral" if wave is None else "unfold",
            "edge": "finite" if wave is None else wave.edge,
            "order": ORDERS[2] if wave is None else ORDERS[0],
            "window": "hann" if wave is None or self.segment is not None else wave.window,
        }
        if wave is None and self.engine in ("auto", "spectral"):
            defaults["window"] = WHOLE_PERIODS
        for name, value in defaults.items():
            given = getattr(self, name)
            if given is None or (isinstance(given, str) and given == "auto"):
                object.__setattr__(self, name, value)

    @property
    def whole_periods(self) -> bool:
        """Whether each emission time weighs the same, over whole periods."""
        return isinstance(self.window, str) and self.window == WHOLE_PERIODS

    @property
    def uses_kernel_response(self) -> bool:
        """Whether the lines come from the impulse responses rather than from the model."""
        return self.response == "kernel" or self.kernel == "causal" or self.engine != "spectral"

    @property
    def memory_bytes(self) -> int | None:
        """``memory`` in bytes."""
        return None if self.memory is None else bytes_of(self.memory)

    @property
    def slab_memory(self) -> int | None:
        """Bytes of the limit for slabs and work: all but what ``unfold`` stages and carries."""
        memory = self.memory_bytes
        return memory if self.engine != "unfold" else (memory and memory - (self.tail_memory or 0))

    @property
    def tail_memory(self) -> int | None:
        """Bytes of the limit for what ``unfold`` stages and carries."""
        memory = self.memory_bytes
        return None if memory is None else max(0, memory - WORK_BYTES) // 2

    def working_device(self, default: torch.device) -> torch.device:
        """The device asked for, checked."""
        text = f"unknown device {self.device!r}; use 'cpu', 'cuda' or 'cuda:1'"
        try:
            device = torch.device(default if self.device is None else self.device)
        except (RuntimeError, TypeError) as error:
            raise ValueError(text) from error
        if device.type not in ("cpu", "cuda"):
            raise ValueError(text)
        if device.type == "cuda" and not torch.cuda.is_available():
            raise ValueError(
                f"device {str(device)!r} is asked for, but torch {torch.__version__} sees no CUDA "
                "device; use device='cpu' or install a CUDA build of torch"
            )
        return device

    def working_dtype(self, default: torch.dtype) -> torch.dtype:
        """The precision asked for, checked; ``direct`` is always float64."""
        wanted = self.dtype
        if isinstance(wanted, str):
            wanted = PRECISIONS[require_choice("dtype", wanted, DTYPES)]
        if wanted is not None and wanted not in PRECISIONS.values():
            raise ValueError(f"dtype is {wanted}; float32 or float64")
        if self.engine == "direct":
            return torch.float64
        return default if wanted is None else wanted

    def model_tolerance(self, dtype: torch.dtype) -> float:
        """``tolerance``, or its default."""
        return self.tolerance or TOLERANCES[self.working_dtype(dtype)]

    def describe(self) -> dict[str, Any]:
        """Plain values for a file."""
        plain = {field.name: getattr(self, field.name) for field in fields(self)}
        plain["incident"] = None if self.incident is None else self.incident.label
        for key in ("device", "dtype"):
            plain[key] = None if plain[key] is None else str(plain[key])
        plain["response"] = "kernel" if self.uses_kernel_response else "model"
        plain["window"] = self.window if isinstance(self.window, str) else list(self.window)
        return plain
