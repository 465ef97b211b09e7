"""How work is timed, in this process or one of its own, and how a row is printed."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import torch

from torchliner.names import resolve

SCRIPTS = Path(__file__).resolve().parent.parent
LONG = 20.0  # s, from which work is run once, not again


def best(work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
    """Seconds of the fastest of some runs after one that is not counted, and what it gave."""
    times: list[float] = []
    while len(times) <= repeats and max(times, default=0.0) <= LONG:
        start = time.perf_counter()
        result = work()
        if torch.cuda.is_available():
            torch.cuda.synchronize()
        times.append(time.perf_counter() - start)
    return min(times[1:] or times), result


def row(name: str, seconds: float, note: str = "", *, error: float | None = None, samples: int | None = None) -> None:
    """Print a time, ns for each of some samples, and what the result is off by."""
    each = "" if samples is None else f"{1e9 * seconds / samples:9.2f} ns"
    off = "" if error is None else f"{error:8.1e}"
    print(f"{name:56s} {seconds:9.3f} s {each:12s} {off:8s} {note}".rstrip(), flush=True)


def apart(work: str, *arguments: str) -> tuple[float, float]:
    """Seconds, and peak memory in MB, of a function, ``module:name``, in a process of its own.

    Its imports are not timed: it returns what is to be timed, a function without arguments. Raises ``RuntimeError``
    where the process fails.
    """
    code = "import benchmarks.harness, sys; benchmarks.harness.child(*sys.argv[1:])"
    # Modules compiled once, as a user has them.
    own = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    own["PYTHONPATH"] = os.pathsep.join([str(SCRIPTS), own.get("PYTHONPATH", "")])
    command = [sys.executable, "-W", "ignore", "-c", code, work, *arguments]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=own)
    if done.returncode:
        raise RuntimeError(f"{work}{arguments} failed: {done.stderr[-1000:]}")
    seconds, peak = json.loads(done.stdout.splitlines()[-1])
    return seconds, peak


def child(work: str, *arguments: str) -> None:
    """The other side of ``apart``."""
    run = resolve(work)(*arguments)
    start = time.perf_counter()
    run()
    seconds = time.perf_counter() - start
    # Not ``ru_maxrss``, which would begin with the peak of the parent.
    peak = next(line for line in Path("/proc/self/status").read_text().splitlines() if line.startswith("VmHWM"))
    print("\n" + json.dumps([seconds, int(peak.split()[1]) / 1024]))
