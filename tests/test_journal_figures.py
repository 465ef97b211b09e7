"""What a journal takes: fonts as text, captions."""

import numpy as np
import pytest
from conftest import plane_of, turbulence

import torchliner as tl

pytest.importorskip("matplotlib")
from torchliner.report import curves
from torchliner.report.figure import frame, subplots

pytestmark = pytest.mark.filterwarnings("ignore::torchliner.DataWarning")


@pytest.fixture(scope="module")
def cases():
    x, z = np.arange(6) * 1e-3, np.arange(5) * 1e-3
    about = {"x": x, "z": z, "reference": {"true": 1 - 0.2j}}
    heights = {f"y{i}.h5": height for i, height in enumerate((2.5e-3, 1e-3, 0.5e-3))}
    return [
        plane_of(v, name=name, height=height, title=f"case, y = {1e3 * height:g} mm", **about)
        for i, (name, height) in enumerate(heights.items())
        for v in [turbulence((5, 6, 480), seed=i, rms=1.0 + i)]
    ]


@pytest.fixture(scope="module")
def found(cases, liner):
    return [tl.educe(plane, liner) for plane in cases]


def test_the_caption_stands_in_the_file_and_text_is_text(found, tmp_path):
    from PIL import Image

    figure = curves.draw_along_x(found, tmp_path / "a.png")
    assert figure.caption.startswith("case, ")
    assert figure.get_suptitle() == ""
    assert Image.open(tmp_path / "a.png").text["Description"] == figure.caption
    figure.savefig(tmp_path / "a.svg")
    figure.savefig(tmp_path / "a.pdf")
    drawn, stored = (tmp_path / "a.svg").read_text(encoding="utf-8"), (tmp_path / "a.pdf").read_bytes()
    assert f"cells, {found[0].averaging}" in drawn
    assert "\N{MINUS SIGN}" in drawn
    assert b"/FontFile2" in stored
    assert b"/Type3" not in stored


def test_limits_show_values_and_break_at_poles():
    axis = subplots(1, 1, 2.0)[1][0, 0]
    x = np.linspace(0, 2, 201)
    axis.plot(x, 1 / (x - 0.995))
    frame(axis)
    assert axis.get_ylim()[1] > 100
    frame(axis, poles=True)
    assert axis.get_ylim()[1] < 50
    assert np.isnan(axis.lines[0].get_ydata()).any()
