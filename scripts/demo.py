"""The eleven shipped cases whose impedance is known, educed at 0.5 mm: a row each and one sentence (`make demo`)."""

import torchliner as tl
from common import options_of, parser_of, plane_files

ROW = "{:<10} {:>16} {:>16}  {}"


def main() -> None:
    """Print a row as soon as it is known; every plane takes seconds."""
    options_of(parser_of(__doc__))
    print(ROW.format("case", "reference Z", "educed Z", "level check"), flush=True)
    errors = []
    files = [*plane_files("slit_*_y0.5mm.h5"), *plane_files("orifice_[ot]*_y0.5mm.h5")]
    for path in files:
        plane = tl.read_plane(path)
        found = tl.educe(plane, tl.load_liner(plane.liner), allow_short=True)
        true, educed, check = plane.reference["true"], complex(found.answer[0]), found.level_check
        words = "-" if check is None else check.words(found.averaging)
        case = path.stem.partition("_")[2].removesuffix("_y0.5mm")
        print(ROW.format(case, f"{true:.3f}", f"{educed:.3f}", words), flush=True)
        if words.endswith("passes"):
            errors.append(abs(educed.real / true.real - 1))
    print(
        f"\nThe level check passes in {len(errors)} of {len(files)} cases, and there R is within "
        f"{100 * max(errors, default=0):.0f} % of the reference; where it fails, calibrate the liner model "
        "(docs/calibration.md)."
    )


if __name__ == "__main__":
    main()
