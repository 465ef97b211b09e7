"""Set the project up and run it, with the standard library alone.

    python3 scripts/bootstrap.py setup|demo|test|test-slow|lint|docs|benchmark

Makes .venv once; later calls find it ready unless pyproject.toml or constraints.txt changed.
Environment variables:
  TORCHLINER_TORCH        requirement for torch (default: the pinned release), or "keep" to use one
                          that you have put into .venv yourself
  TORCHLINER_TORCH_INDEX  index URL to take torch from, and nothing else: that of the CPU or CUDA
                          builds, as the install page of PyTorch shows it for your platform
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
ENVIRONMENT = ROOT / ".venv"
BIN = ENVIRONMENT / ("Scripts" if os.name == "nt" else "bin")
PYTHON = BIN / ("python.exe" if os.name == "nt" else "python")
STAMP = ENVIRONMENT / ".torchliner-stamp"
OLDEST = (3, 11)
# Called from inside .venv, sys.executable would vanish with it when it is made anew.
BASE = getattr(sys, "_base_executable", sys.executable)


def run(*command: str | Path) -> None:
    """Run a command in the project's folder; stop with its exit code if it fails."""
    code = subprocess.call([str(part) for part in command], cwd=ROOT)
    if code:
        sys.exit(code)


def make_environment() -> None:
    """A virtual environment with pip in it, also where the ensurepip module is missing."""
    if ENVIRONMENT.exists():
        shutil.rmtree(ENVIRONMENT)
    made = subprocess.run([BASE, "-m", "venv", ENVIRONMENT], cwd=ROOT, capture_output=True, text=True)
    if made.returncode == 0:
        return
    shutil.rmtree(ENVIRONMENT, ignore_errors=True)
    print("venv has no ensurepip; taking pip from the calling Python", flush=True)
    run(BASE, "-m", "venv", "--without-pip", ENVIRONMENT)
    code = subprocess.call([BASE, "-m", "pip", "--python", PYTHON, "install", "-q", "pip"])
    if code:
        sys.exit(
            "This Python can make no environment with pip in it. Install its venv package "
            "(python3-venv on Debian) or another Python, and call again."
        )


def pinned_torch() -> str:
    """torch as constraints.txt pins it."""
    found = re.search(r"^torch==\S+", (ROOT / "constraints.txt").read_text(), re.MULTILINE)
    return found.group(0) if found else "torch"


def setup() -> None:
    """Make or refresh .venv; does nothing if it is up to date."""
    if sys.version_info < OLDEST:
        sys.exit(f"Python {OLDEST[0]}.{OLDEST[1]} or later is needed; this is {sys.version}")
    torch = os.environ.get("TORCHLINER_TORCH", "")
    index = os.environ.get("TORCHLINER_TORCH_INDEX", "")
    wanted = hashlib.sha256(
        b"".join((ROOT / name).read_bytes() for name in ("pyproject.toml", "constraints.txt"))
        + f"{torch}|{index}|{sys.version_info[:2]}".encode()
    ).hexdigest()
    if PYTHON.exists() and STAMP.exists() and STAMP.read_text() == wanted:
        return
    print("setting up .venv (a minute or two, once)", flush=True)
    if not (torch == "keep" and PYTHON.exists()):
        make_environment()
    pip: list[str | Path] = [PYTHON, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    if torch != "keep":
        # torch alone first: the builds' index must never serve the other packages.
        source = ["--index-url", index] if index else []
        run(*pip, "--no-deps", *source, torch or pinned_torch())
    constraints: list[str | Path] = ["-c", "constraints.txt"]
    if torch:
        free = ENVIRONMENT / "constraints-without-torch.txt"
        lines = (ROOT / "constraints.txt").read_text().splitlines()
        free.write_text("\n".join(line for line in lines if not line.startswith("torch==")))
        constraints = ["-c", free]
    run(*pip, *constraints, "-e", ".[test]")
    STAMP.write_text(wanted)


def lint() -> None:
    """Style and types."""
    run(PYTHON, "-m", "ruff", "check", ".")
    run(PYTHON, "-m", "ruff", "format", "--check", ".")
    run(PYTHON, "-m", "mypy")


def tests_of(marker: str) -> None:
    """Tests side by side, each with one thread: torch's own would stand in each other's way."""
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    side_by_side = ["-n", "auto", "--maxprocesses", "4"]
    run(PYTHON, "-m", "pytest", *side_by_side, "-m", marker)


def test() -> None:
    """Lint, types, all tests but the slow ones; the README's example is one of them."""
    lint()
    tests_of("not slow")


def test_slow() -> None:
    """The tests that ``test`` leaves out: statistics of many trials, long records, the kernel for CUDA."""
    pinned('triton; platform_system == "Linux"')
    tests_of("slow")


def demo() -> None:
    """The main job on the shipped data."""
    run(PYTHON, "scripts/demo.py")


def pinned(*packages: str) -> None:
    """What one task alone needs, in the versions of constraints.txt."""
    pip: list[str | Path] = [PYTHON, "-m", "pip", "install", "-q", "--disable-pip-version-check"]
    run(*pip, "-c", "constraints.txt", *packages)


def docs() -> None:
    """The site in docs/build/html; a warning is an error."""
    listed = (ROOT / "pyproject.toml").read_text().split("\ndocs = [")[1].split("]\n")[0]
    pinned(*(name for name in re.findall(r'"([^"]+)"', listed) if "torchliner" not in name))
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    html = ROOT / "docs" / "build" / "html"
    run(PYTHON, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "docs", html)
    print(f"{html / 'index.html'}")


def benchmark() -> None:
    """Time and error of the engines, beside the published recipe compiled by numba."""
    pinned("numba")
    run(PYTHON, "scripts/benchmark.py")


TASKS = {
    "setup": None,
    "demo": demo,
    "test": test,
    "test-slow": test_slow,
    "lint": lint,
    "docs": docs,
    "benchmark": benchmark,
}


def main() -> None:
    """Run one task by name."""
    if len(sys.argv) != 2 or sys.argv[1] not in TASKS:
        print(__doc__)
        sys.exit(0 if sys.argv[1:] in (["-h"], ["--help"]) else 2)
    setup()
    task = TASKS[sys.argv[1]]
    if task is not None:
        task()


if __name__ == "__main__":
    main()
