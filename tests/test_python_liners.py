"""A liner as a Python file of the user's own: what it may hold, and errors with the file's line."""

import pytest
import torch

import torchliner as tl
from torchliner.campaign.campaign_file import read_campaign


def write(path, *lines):
    path.write_text("\n".join(lines) + "\n", encoding="utf-8")
    return path


MINE = """
import torch

cell_pitch = 5e-3
hole_diameter = 1e-3


def impedance(frequency, speed):
    return torch.complex(0.2 + 0.3 * speed + 0 * frequency, 1e-3 * frequency + 0 * speed)
"""


def test_a_python_file_is_a_liner(tmp_path):
    found = tl.load_liner(write(tmp_path / "mine.py", MINE))
    z = found.impedance([[500.0], [800.0]], [0.0, 2.0])
    assert z.tolist() == [[0.2 + 0.5j, 0.8 + 0.5j], [0.2 + 0.8j, 0.8 + 0.8j]]
    assert (found.cell_pitch, found.hole_diameter, found.fluid) == (5e-3, 1e-3, None)
    about = found.describe()
    assert (about["model"], about["name"], about["file"]) == ("python", "mine", "mine.py")
    assert len(about["sha256"]) == 64
    steady = torch.full((2, 900), 2.0, dtype=torch.float64)
    plane = tl.VelocityPlane(steady, sampling_rate=42e3, frequency=800.0, x=[0.0, 2e-3])
    assert complex(tl.educe(plane, found, interval=None).answer[0]) == pytest.approx(0.8 + 0.8j)


def test_a_python_file_may_hold_an_object(tmp_path):
    lines = ["import torchliner as tl", "liner = tl.load_liner('onera').replace(name='mine')"]
    found = tl.load_liner(write(tmp_path / "a.py", *lines))
    assert found == tl.load_liner("onera").replace(name="mine")
    lines = "class Mine:", "    speed_max = 3.0", "    impedance = lambda self, f, v: [1 + 0.1j]", "liner = Mine()"
    found = tl.load_liner(write(tmp_path / "b.py", *lines))
    assert found.speed_max == 3.0
    assert found.impedance([1.0, 2.0], 0.0).tolist() == [1 + 0.1j] * 2  # not in complex64


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("def impedance(f, v:\n    return f", r"line 1: SyntaxError: '\(' was never c"),
        ("x = 1\n\ny = x / 0", "line 3: ZeroDivisionError"),
        ("import sys\nsys.exit(3)", "line 2: SystemExit: 3"),
        ("def impedence(f, v): return 1j", r"must define a function impedance\(frequency, speed\)"),
        ("def impedance(f, v):\n    x = 1\n    return f.nothing", r"line 3: AttributeError"),
        ("def impedance(f, v): return [1j] * 3", r"gave shape \(3,\); \(2,\) is needed"),
        ("def impedance(f, v): return f * float('nan') + 1j", "gave nan, inf or -1 between 500 and 800 Hz"),
    ],
)
def test_files_and_functions_that_fail_are_named(tmp_path, text, message):
    path = write(tmp_path / "mine.py", text)
    with pytest.raises(ValueError, match=f"mine.py.*{message}"):
        tl.load_liner(path).impedance([500.0, 800.0], 0.0)


def test_no_toml_runs_a_python_file(tmp_path):
    """Neither as the table of a liner file nor as the liner of a campaign."""
    ran = tmp_path / "ran"
    write(tmp_path / "mine.py", f"open({str(ran)!r}, 'w').close()", MINE)
    for text in ("model = 'table'\nvalues = 'mine.py'", "model = 'mine.py'"):
        with pytest.raises(ValueError, match=r"a.toml|mine.py"):
            tl.load_liner(write(tmp_path / "a.toml", text))
    write(tmp_path / "c.toml", "liners = ['mine.py']", "[[planes]]", "files = 'x.h5'")
    (tmp_path / "x.h5").touch()
    with pytest.raises(ValueError, match=r"liner mine.py is a program, which no campaign runs"):
        read_campaign(tmp_path / "c.toml")
    assert not ran.exists()
    tl.load_liner(tmp_path / "mine.py")
    assert ran.exists()
