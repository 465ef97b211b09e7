"""Set the project up and run it, with the standard library alone.

    python3 scripts/bootstrap.py setup|demo|test|test-slow|lint|docs|benchmark

Makes .venv once; later calls find it ready unless pyproject.toml or constraints.txt changed.
Environment variables:
  TORCHLINER_TORCH        requirement for torch (default: the pinned release), or "keep" to use one
                          that you have put into .venv yourself
  TORCHLINER_TORCH_INDEX  index URL to take torch from, and nothing else: that of the CPU or CUDA
                          builds, as the install page of PyTorch shows it for your platform
"""

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
LINT = ["-m ruff check .", "-m ruff format --check .", "-m mypy"]
PYTEST = "-m pytest -n auto --maxprocesses 4 -m"
TASKS = {  # commands of .venv's Python, one after the other
    "setup": [],
    "lint": LINT,
    "test": [*LINT, f"{PYTEST} not_slow"],
    "test-slow": [f"{PYTEST} slow"],
    "demo": ["scripts/demo.py"],
    "docs": ["-m sphinx -W --keep-going -q -b html docs docs/build/html"],
    "benchmark": ["scripts/benchmark.py"],
}


def run(*command: str | Path) -> None:
    """Run a command in the project's folder; stop with its exit code if it fails."""
    if code := subprocess.call([str(part) for part in command], cwd=ROOT):
        sys.exit(code)


def make_environment() -> None:
    """A virtual environment with pip in it, also where the ensurepip module is missing."""
    shutil.rmtree(ENVIRONMENT, ignore_errors=True)
    if subprocess.run([BASE, "-m", "venv", ENVIRONMENT], cwd=ROOT, capture_output=True).returncode == 0:
        return
    shutil.rmtree(ENVIRONMENT, ignore_errors=True)
    print("venv has no ensurepip; taking pip from the calling Python", flush=True)
    run(BASE, "-m", "venv", "--without-pip", ENVIRONMENT)
    if subprocess.call([BASE, "-m", "pip", "--python", PYTHON, "install", "-q", "pip"]):
        sys.exit(
            "This Python can make no environment with pip in it. Install its venv package "
            "(python3-venv on Debian) or another Python, and call again."
        )


def install(*what: str | Path) -> None:
    """With pip, quietly."""
    run(PYTHON, "-m", "pip", "install", "-q", "--disable-pip-version-check", *what)


def setup() -> None:
    """Make or refresh .venv; does nothing if it is up to date."""
    if sys.version_info < OLDEST:
        sys.exit(f"Python {OLDEST[0]}.{OLDEST[1]} or later is needed; this is {sys.version}")
    torch, index = (os.environ.get(f"TORCHLINER_TORCH{end}", "") for end in ("", "_INDEX"))
    pins = (ROOT / "constraints.txt").read_text()
    state = f"{(ROOT / 'pyproject.toml').read_text()}{pins}{torch}|{index}|{sys.version_info[:2]}"
    wanted = hashlib.sha256(state.encode()).hexdigest()
    if PYTHON.exists() and STAMP.exists() and STAMP.read_text() == wanted:
        return
    print("setting up .venv (a minute or two, once)", flush=True)
    if not (torch == "keep" and PYTHON.exists()):
        make_environment()
    if torch != "keep":
        # torch alone first: the builds' index must never serve the other packages.
        pinned = re.findall(r"^torch==\S+", pins, re.MULTILINE)
        install("--no-deps", *(["--index-url", index] if index else []), torch or (pinned or ["torch"])[0])
    constraints = ENVIRONMENT / "constraints-without-torch.txt" if torch else ROOT / "constraints.txt"
    if torch:
        constraints.write_text(re.sub(r"^torch==.*\n", "", pins, flags=re.MULTILINE))
    install("-c", constraints, "-e", ".[test]")
    STAMP.write_text(wanted)


def main() -> None:
    """Run one task by name."""
    if len(sys.argv) != 2 or sys.argv[1] not in TASKS:
        print(__doc__)
        sys.exit(0 if sys.argv[1:] in (["-h"], ["--help"]) else 2)
    setup()
    task = sys.argv[1]
    if task == "docs":
        listed = (ROOT / "pyproject.toml").read_text().split("\ndocs = [")[1].split("]\n")[0]
        install("-c", "constraints.txt", *(n for n in re.findall(r'"([^"]+)"', listed) if "torchliner" not in n))
    if task == "test-slow":
        install("-c", "constraints.txt", 'triton; platform_system == "Linux"')
    if task in ("test", "test-slow", "docs"):
        os.environ.setdefault("OMP_NUM_THREADS", "1")  # beside others, more would stand in each other's way
    for command in TASKS[task]:
        run(PYTHON, *(word.replace("not_slow", "not slow") for word in command.split()))


if __name__ == "__main__":
    main()
