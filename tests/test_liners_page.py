"""docs/liners.md: its files, its command's output and its numbers are those of the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

import torchliner as tl
from torchliner.cli.main import main

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "liners.md").read_text(encoding="utf-8")
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def block(kind: str) -> str:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[-1]


def test_the_command_prints_what_the_page_shows(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    Path("goodrich.toml").write_text(block("toml"), encoding="utf-8")
    Path("mine.py").write_text(block("py"), encoding="utf-8")
    command = block("sh").replace("\\\n", " ").split()[1:]
    assert main([*command, "--quiet"]) == 0
    assert capsys.readouterr().out == block("text")


def test_the_measured_sample_says_what_the_page_says():
    """Both presets against the measured Z, from 500 and from 800 to 2500 Hz: docs/validation.md."""
    measured = tl.load_liner(ROOT / "data" / "ufsc_measured.csv")
    frequency, rows = measured.frequency, []
    for name in ("polito", "polito_as_printed"):
        liner = tl.load_liner(name)
        driven = [
            complex(tl.ir_tdibc(liner, [130.0], f, kernel="periodic").fixed_points[0][0].impedance[0])
            for f in frequency.tolist()
        ]
        both = liner.impedance(frequency), torch.tensor(driven, dtype=torch.complex128)
        for low in (500, 800):
            off = []
            for impedance in both:
                away = (impedance - measured.impedance(frequency))[frequency >= low]
                off += [f"{float(part.square().mean().sqrt()):.3f}" for part in (away.real, away.imag)]
            rows.append(f"| `{name}` | {low}–2500 | {' | '.join(off)} |")
    page = (ROOT / "docs" / "validation.md").read_text(encoding="utf-8")
    assert "\n".join(rows) in page, "\n".join(rows)
