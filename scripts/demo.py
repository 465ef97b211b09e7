"""The main job on the shipped data: maps, pictures, table of all rules, null test (`make demo`)."""

from __future__ import annotations

import sys
from pathlib import Path

from common import DATA, RESULTS, ROOT, plane_files
from torchliner.cli.main import main as torchliner

CASES = (
    ("slit_n130", "Resolved slit liner, 130 dB, no flow (two-dimensional)"),
    ("slit_g03_145", "Resolved slit liner, 145 dB, Mach 0.3 (two-dimensional: a stress test)"),
    ("orifice_o145", "Resolved orifice, 145 dB, no flow (three-dimensional)"),
)


def run(*arguments: str | Path) -> None:
    """One command of torchliner, shown as it would be typed."""
    words = [str(a) for a in arguments]
    shown = [word.replace(str(ROOT) + "/", "") for word in words if not word.startswith(str(DATA))]
    planes = [word for word in words if word.startswith(str(DATA))]
    if planes:
        shown.insert(1, Path(planes[0]).relative_to(ROOT).as_posix())
        shown.insert(2, f"... ({len(planes)} files)" if len(planes) > 1 else "")
    print(f"\n$ torchliner {' '.join(word for word in shown if word)}", flush=True)
    code = torchliner(words)
    if code:
        sys.exit(code)


def main() -> None:
    RESULTS.mkdir(exist_ok=True)
    for name, title in CASES:
        print(f"\n== {title}")
        folder = RESULTS / name
        folder.mkdir(exist_ok=True)
        files = plane_files(f"{name}_y*.h5")
        run("educe", *files, "-o", folder / "map.h5", "--figure", folder, "--quiet")
    print("\n== Turbulence over a hard wall, educed with a liner's model: the null test")
    for name, pattern in (("channel", "channel_y*.h5"), ("channel_tone", "channel_tone_*.h5")):
        folder = RESULTS / name
        folder.mkdir(exist_ok=True)
        where = ("-o", folder / "map.h5", "--figure", folder)
        model = ("--liner", "polito", "--frequency", "1400")
        run("educe", *plane_files(pattern), *model, *where, "--quiet")
    print("\n== Every rule beside the reference impedance")
    resolved = [path for case in ("slit_*", "orifice_*") for path in plane_files(f"{case}.h5")]
    run("validate", *resolved, "-o", RESULTS / "truth.csv")
    print(f"\nMaps (.h5), numbers (.csv) and pictures (.png) are in {RESULTS}")


if __name__ == "__main__":
    main()
