"""How work is timed, in this process or one of its own, and how a row is printed."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from torchliner.names import resolve

SCRIPTS = Path(__file__).resolve().parent.parent


@dataclass(frozen=True)
class Bench:
    """What was asked for.

    Args:
        full: the sizes of the paper.
        seconds: from which work is run once, not again.
        device: of the engine.
        folder: for large files; None for a temporary one.
    """

    full: bool
    seconds: float
    device: torch.device
    folder: Path | None

    def best(self, work: Callable[[], Any], repeats: int = 3) -> tuple[float, Any]:
        """Seconds of the fastest of some runs after one that is not counted, and what it gave."""
        fastest = float("inf")
        for number in range(repeats + 1):
            start = time.perf_counter()
            result = work()
            if self.device.type == "cuda":
                torch.cuda.synchronize()
            spent = time.perf_counter() - start
            fastest = min(fastest, spent) if number else fastest
            if spent > self.seconds:
                return min(fastest, spent), result
        return fastest, result


def row(name: str, seconds: float, note: str = "", *, error: float | None = None, samples: int | None = None) -> None:
    """Print a time, ns for each of some samples, and what the result is off by."""
    each = "" if samples is None else f"{1e9 * seconds / samples:9.2f} ns"
    off = "" if error is None else f"{error:8.1e}"
    print(f"{name:56s} {seconds:9.3f} s {each:12s} {off:8s} {note}".rstrip(), flush=True)


def apart(work: str, *arguments: Any) -> dict[str, Any]:
    """A function, ``module:name``, in a process of its own: seconds, cpu, peak in MB and what it added to it, result.

    The work's imports are not timed: the function returns what is to be timed, a function without arguments.

    Raises:
        RuntimeError: it failed.
    """
    code = "import benchmarks.harness, sys; benchmarks.harness.child(*sys.argv[1:])"
    # Modules compiled once, as a user has them.
    own = {key: value for key, value in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    own["PYTHONPATH"] = os.pathsep.join([str(SCRIPTS), own.get("PYTHONPATH", "")])
    command = [sys.executable, "-W", "ignore", "-c", code, work, json.dumps(arguments)]
    done = subprocess.run(command, capture_output=True, text=True, check=False, env=own)
    if done.returncode:
        raise RuntimeError(f"{work}{arguments} failed: {done.stderr[-1000:]}")
    found: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return found


def child(work: str, arguments: str) -> None:
    """The other side of ``apart``."""
    run = resolve(work)(*json.loads(arguments))
    before, start, cpu = peak(), time.perf_counter(), time.process_time()
    result = run()
    found = {"seconds": time.perf_counter() - start, "cpu": time.process_time() - cpu, "peak": peak()}
    print("\n" + json.dumps(found | {"added": found["peak"] - before, "result": result}))


def peak() -> float:
    """MB that this process held at most; ``ru_maxrss`` would begin with the peak of its parent."""
    status = Path("/proc/self/status").read_text()
    return next(int(line.split()[1]) for line in status.splitlines() if line.startswith("VmHWM")) / 1024
