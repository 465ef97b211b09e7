"""A plane that streams by: how many probes one machine keeps up with, and how soon a map is there.

    python scripts/benchmark_stream.py

Section 5.5.2 of the paper: 27 400 probes at 200 kHz. Samples come in pieces of some periods of the
tone; the latency of a map counts from the last sample, error bars and cells included.
"""

from __future__ import annotations

import argparse
import json
import time
import warnings

import torch

import torchliner as tl

PROBES, RATE, TONE = 27_400, 200e3, 1400.0
PERIODS, PIECES = 4, 8
PITCH = 2e-4  # m, of the probes; 0.0124 m of a cell


def stream_rows(
    probes: int = PROBES, liner: str = "onera", pieces: int = PIECES, threads: int | None = None
) -> list[dict[str, float | str]]:
    """One row with error bars and one without.

    Args:
        probes: P.
        liner: preset.
        pieces: of 4 periods each, after a first one that is not timed.
        threads: of torch; default as they are.
    Returns:
        ns a sample, latency in ms with and without error bars, probes that keep up at 200 kHz.
    """
    if threads is not None:
        torch.set_num_threads(threads)
    model = tl.load_liner(liner)
    length = round(PERIODS * RATE / TONE)
    generator = torch.Generator().manual_seed(0)
    v = torch.randn(length + 1, probes, generator=generator)[:length].T
    x = PITCH * torch.arange(probes, dtype=torch.float64)
    rows: list[dict[str, float | str]] = []
    for interval in (0.95, None):
        first = tl.VelocityPlane(v, sampling_rate=RATE, frequency=TONE, x=x, name="stream")
        going = tl.GrowingMoments(first, model, interval=interval)
        begin, cpu = time.perf_counter(), time.process_time()
        for _ in range(pieces):
            going.update(v)
        updated = (time.perf_counter() - begin) / (pieces * length)
        cpu = (time.process_time() - cpu) / (pieces * length)
        begin = time.perf_counter()
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            going.educe(model, interval=interval)
        latency = time.perf_counter() - begin
        nodes = going.moments().nodes
        assert nodes is not None
        rows.append({
            "error bars": "yes" if interval else "no", "probes": probes,
            "threads": torch.get_num_threads(), "K": nodes.count,
            "ns a sample": 1e9 * updated / probes, "ns CPU a sample": 1e9 * cpu / probes,
            "probes that keep up at 200 kHz": int(probes / (updated * RATE)),
            "map after the last sample, ms": 1e3 * (latency + updated * length),
        })  # fmt: skip
    return rows


def main() -> None:
    """Print the rows."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--probes", type=int, default=PROBES, help="default 27400")
    parser.add_argument("--threads", type=int, help="of torch; default as they are")
    options = parser.parse_args()
    print(json.dumps(stream_rows(options.probes, threads=options.threads), indent=2))


if __name__ == "__main__":
    main()
