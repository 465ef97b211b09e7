from pathlib import Path

import torchliner as tl

DATA = Path(__file__).parent.parent / "data"


def test_case_n130_beside_its_truth():
    plane = tl.read_plane(DATA / "slit_n130_y2.5mm.h5")
    found = tl.educe(plane, tl.load_liner("lbm_slit"))
    wanted = plane.reference["true"]
    assert abs(complex(found.liner_impedance_velocity_first[0]) - wanted) < 0.01
