"""docs/liners.md: its files, its command's output and its numbers are those of the code."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
import torch

import torchliner as tl
from torchliner.cli.main import main
from torchliner.liners.laws import LAWS
from torchliner.report.table import format_complex

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "liners.md").read_text(encoding="utf-8")
pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


def block(kind: str) -> str:
    return re.findall(rf"```{kind}\n(.*?)```", PAGE, re.DOTALL)[-1]


def test_the_command_prints_what_the_page_shows(tmp_path, monkeypatch, capsys):
    """With the files as the page gives them."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "data").symlink_to(ROOT / "data")
    Path("goodrich.toml").write_text(block("toml"), encoding="utf-8")
    Path("mine.py").write_text(block("py"), encoding="utf-8")
    command = block("sh").replace("\\\n", " ").split()[1:]
    assert main([*command, "--quiet"]) == 0
    assert capsys.readouterr().out == block("text")


def test_the_table_of_all_laws_is_current(monkeypatch):
    """Every row is what the page's example prints; no law is forgotten."""
    monkeypatch.chdir(ROOT)
    printed: dict[str, dict[str, complex]] = {}
    names = {"tl": tl, "print": lambda case, rows: printed.update({case: dict(rows)})}
    exec(compile(block("python"), "docs/liners.md", "exec"), names)
    rows = dict(re.findall(r"^\| ([\w-]+) \| ((?:\S+j \| ){2}\S+j) \|$", PAGE, re.MULTILINE))
    for case in printed:
        plane = tl.read_plane(ROOT / "data" / f"orifice_{case}_y0.5mm.h5", lazy=True)
        printed[case]["reference"] = plane.reference["true"]
    assert list(rows) == ["reference", *(law for law in LAWS if law != "mesh")]
    for name, cells in rows.items():
        wanted = " | ".join(format_complex(found[name]) for found in printed.values())
        assert cells.replace("−", "-") == wanted


def test_every_law_stands_in_the_table_with_its_parameters():
    rows = dict(re.findall(r"^\| `([\w-]+)` \| (.*)\|$", PAGE, re.MULTILINE))
    assert set(rows) == set(LAWS)
    for law, text in rows.items():
        layers = [
            each
            for name in tl.preset_names()
            if name.endswith("_example")
            for each in tl.load_liner(name).layers
            if each.kind == law
        ]
        own = set(layers[0].numbers()) - {"thickness", "orifice_diameter", "porosity"}
        assert own == {word for word in re.findall(r"`(\w+)`", text) if word in own}, law
        assert own == set(re.findall(r"`(\w+)`", text.rsplit("|", 1)[-1])), law


def test_the_measured_sample_says_what_the_page_says():
    """Both presets against the measured Z, 800 to 2500 Hz: docs/truth.md."""
    measured = tl.load_liner(ROOT / "data" / "ufsc_measured.csv")
    frequency = measured.frequency[measured.frequency >= 800]
    rows = []
    for name in ("polito", "polito_as_printed"):
        liner, off = tl.load_liner(name), []
        driven = [
            complex(tl.ir_tdibc(liner, [130.0], f, kernel="periodic").fixed_points[0][0].impedance[0])
            for f in frequency.tolist()
        ]
        for impedance in (liner.impedance(frequency), torch.tensor(driven, dtype=torch.complex128)):
            away = impedance - measured.impedance(frequency)
            off += [f"{float(part.square().mean().sqrt()):.3f}" for part in (away.real, away.imag)]
        rows.append(f"| `{name}` | {' | '.join(off)} |")
    page = (ROOT / "docs" / "truth.md").read_text(encoding="utf-8")
    assert "\n".join(rows) in page, "\n".join(rows)
