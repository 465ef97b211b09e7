"""Cut the shipped planes and pressures in data/ out of the project's full simulation files.

    python scripts/make_data.py FOLDER

FOLDER holds resolved_liner_lbm.h5, resolved_orifice_3d.h5, resolved_more.h5, resolved_background.h5 and
les_channel_planes.h5. What is cut, rounded and superposed is stated in each file and in
data/README.md; checksums go to data/SHA256SUMS. ``--only`` writes a part alone.
"""

from __future__ import annotations

import dataclasses
import hashlib
from collections.abc import Callable, Sequence
from pathlib import Path

import torch
from torch import Tensor

from common import DATA, parser_of
from studies.resolved_cases import read_channel, read_resolved
from studies.resolved_pressure import read_resolved_pressure
from torchliner.io.plane_writer import write_plane
from torchliner.io.pressure_file import write_pressure
from torchliner.records import VelocityPlane

SLIT_FILE, ORIFICE_FILE = "resolved_liner_lbm.h5", "resolved_orifice_3d.h5"
MORE_FILE, MORE_LINES = "resolved_more.h5", (0, 1, 4)
MORE_CASES = {"n145": "slit", "o130": "orifice", "t00_130": "orifice", "t03_130": "orifice", "t015_145": "orifice"}
BACKGROUND_FILE = "resolved_background.h5"
BACKGROUND_CASES = {  # which of the five heights are kept
    **dict.fromkeys(("q01_140", "q02_140", "q02_145", "q01_off", "q015_off", "q02_off", "q03_off"), (0, 1)),
    **dict.fromkeys(("q02_140h", "q02_145h", "q02_offh"), (0, 2, 4)),
}
NAMED_CASE = "lbm_slit"  # of the g cases: the linear part of their lattice was not measured
SLIT_CASES, SLIT_LINES = ("n115", "n130", "g01_145", "g03_145"), (0, 1, 2, 4)
ORIFICE_CASES, ORIFICE_LINES = ("o115", "o145"), (0, 1, 4)
CHANNEL_PLANES = (0, 1, 2)
STREAMWISE_LINE = 1  # the streamwise velocity is kept at y = 1 mm alone
LENGTH, VELOCITY = 0.02, 749.06  # half height 20 mm, bulk velocity 100 m/s
BULK_VELOCITY = 100.0
MANTISSA_BITS = 11  # relative rounding 2.4e-4, far below the scatter of any record
FEWER_BITS = 7  # of the cases of MORE_FILE: 3.9e-3 a sample, 3e-5 in Z, two thirds of the size
PRESSURE_STRIDE = {
    "n115": 2,
    "n130": 2,
    "n145": 2,
}  # symmetric: 1e-7 in Z; with flow it would cost 5e-3
FILES = {SLIT_FILE: SLIT_CASES, ORIFICE_FILE: ORIFICE_CASES, MORE_FILE: tuple(MORE_CASES)}
HOLES = {  # tables by geometry, and a case that has it
    "slit_n": (SLIT_FILE, "n130"),
    "slit_g": (SLIT_FILE, "g03_145"),
    "orifice_o": (ORIFICE_FILE, "o145"),
    "orifice_t00": (MORE_FILE, "t00_130"),
    "orifice_t": (MORE_FILE, "t03_130"),
}
TONE = (1400.0, 1.0)  # Hz, peak m/s into the liner


def rounded(values: Tensor, bits: int = MANTISSA_BITS) -> Tensor:
    """float32 with the mantissa rounded to ``bits``, so that gzip has less to store."""
    drop = 23 - bits
    pattern = values.to(torch.float32).contiguous().view(torch.int32)
    return ((pattern + (1 << (drop - 1))) & -(1 << drop)).view(torch.float32)


def prepared(plane: VelocityPlane, bits: int = MANTISSA_BITS, **extra: object) -> VelocityPlane:
    """The plane with rounded velocities and the rounding on record."""
    stream = None if plane.streamwise is None else rounded(plane.streamwise, bits)
    provenance = {**plane.provenance, **extra, "mantissa_bits": bits}
    return dataclasses.replace(
        plane,
        velocity=rounded(plane.velocity, bits),
        streamwise=stream,
        provenance=provenance,
        holes=None,  # a table of its own for each geometry
    )


def with_tone(plane: VelocityPlane) -> VelocityPlane:
    """The plane plus a tone of one phase everywhere: v_in = A cos(2 pi f t), v = -v_in."""
    frequency, amplitude = TONE
    time = torch.arange(plane.samples, dtype=torch.float64) / plane.sampling_rate
    tone = -amplitude * torch.cos(2 * torch.pi * frequency * time)
    return dataclasses.replace(
        plane,
        velocity=(plane.velocity + tone).to(torch.float32),
        frequency=frequency,
        title=f"{plane.title}, superposed tone {amplitude:g} m/s at {frequency:g} Hz",
        provenance={**plane.provenance, "superposed_tone": f"{amplitude:g} m/s peak, phase 0"},
    )


def millimetres(plane: VelocityPlane) -> float:
    """Height for a file name."""
    assert plane.height is not None
    return 1e3 * plane.height


def write(plane: VelocityPlane, name: str) -> None:
    """One compressed plane file in data/."""
    path = DATA / name
    write_plane(plane, path, compress=True)
    print(f"{name:32s} {path.stat().st_size / 1e6:6.2f} MB  {plane.title}")


def make_slits(folder: Path) -> None:
    """Planes over the resolved slit."""
    for case in SLIT_CASES:
        for line in SLIT_LINES:
            plane = read_resolved(folder / SLIT_FILE, case, line, stride=2)
            if line != STREAMWISE_LINE:
                plane = dataclasses.replace(plane, streamwise=None)
            plane = dataclasses.replace(plane, liner=plane.liner or NAMED_CASE)
            write(prepared(plane), f"slit_{case}_y{millimetres(plane):.1f}mm.h5")


def make_orifices(folder: Path) -> None:
    """Planes over the resolved orifice."""
    for case in ORIFICE_CASES:
        for line in ORIFICE_LINES:
            plane = read_resolved(folder / ORIFICE_FILE, case, line)
            write(prepared(plane), f"orifice_{case}_y{millimetres(plane):.1f}mm.h5")


def make_more(folder: Path) -> None:
    """Levels between, and turbulence over the orifice."""
    for case, kind in MORE_CASES.items():
        for line in MORE_LINES:
            stride = 2 if kind == "slit" else 1
            plane = read_resolved(folder / MORE_FILE, case, line, stride)
            write(prepared(plane, FEWER_BITS), f"{kind}_{case}_y{millimetres(plane):.1f}mm.h5")


def make_background(folder: Path) -> None:
    """Sound over turbulence at several levels, and the same flows without sound, which state no tone."""
    for case, lines in BACKGROUND_CASES.items():
        for line in lines:
            plane, name = read_resolved(folder / BACKGROUND_FILE, case, line), f"orifice_{case}"
            if "off" in case:
                plane = dataclasses.replace(plane, frequency=None, incident_level=None, source_side="none")
                name = f"quiet_{case.replace('_off', '')}"
            write(prepared(plane, FEWER_BITS), f"{name}_y{millimetres(plane):.{1 + (line == 4)}f}mm.h5")


def make_channel(folder: Path) -> None:
    """Planes over the hard wall, and one with a tone."""
    for index in CHANNEL_PLANES:
        plane = read_channel(folder / "les_channel_planes.h5", index, LENGTH, VELOCITY)
        stream = plane.streamwise
        plane = dataclasses.replace(
            plane,
            velocity=plane.velocity[::2, :, ::2],
            streamwise=None if stream is None else stream[::2, :, ::2],
            z=plane.z[::2],
            sampling_rate=plane.sampling_rate / 2,
            mach=BULK_VELOCITY / plane.fluid.sound_speed,
        )
        name = f"channel_y{millimetres(plane):.2f}mm.h5"
        write(prepared(plane, stride_time=2, stride_z=2), name)
        if index == 1:
            toned = with_tone(dataclasses.replace(plane, streamwise=None))
            toned = prepared(toned, stride_time=2, stride_z=2)
            write(toned, name.replace("channel_", "channel_tone_"))


def make_pressures(folder: Path, which: Sequence[str] = tuple(FILES)) -> None:
    """Pressures of the resolved cases: on the surface rounded, elsewhere as they are."""
    for name in which:
        bits = FEWER_BITS if name == MORE_FILE else MANTISSA_BITS
        for case in FILES[name]:
            whole = read_resolved_pressure(folder / name, case, PRESSURE_STRIDE.get(case, 1))
            record = dataclasses.replace(
                whole,
                facesheet=rounded(whole.facesheet, bits),
                provenance={**whole.provenance, "mantissa_bits_surface": bits},
            )
            path = DATA / f"pressure_{case}.h5"
            write_pressure(record, path)
            print(f"{path.name:32s} {path.stat().st_size / 1e6:6.2f} MB  {record.title}")


def make_holes(folder: Path) -> None:
    """Where the open nodes of the facesheets are, a table for each geometry."""
    for name, (file, case) in HOLES.items():
        holes = read_resolved(folder / file, case, 0).holes
        assert holes is not None
        columns = {"x [mm]": holes.x, "z [mm]": holes.z, "diameter [mm]": holes.diameter}
        kept = {label: values for label, values in columns.items() if values is not None}
        rows = (",".join(f"{1e3 * value:.6g}" for value in row) for row in zip(*kept.values(), strict=True))
        (DATA / f"holes_{name}.csv").write_text("\n".join([",".join(kept), *rows]) + "\n")


def main() -> None:
    parser = parser_of(__doc__)
    parser.add_argument("folder", type=Path, help="folder with the five full simulation files")
    parts: dict[str, Callable[[Path], None]] = {
        "slits": make_slits,
        "orifices": make_orifices,
        "channel": make_channel,
        "more": make_more,
        "background": make_background,
        "pressures": make_pressures,
        "holes": make_holes,
    }
    parser.add_argument("--only", choices=list(parts), nargs="+", help="leave the others as is")
    options = parser.parse_args()
    DATA.mkdir(exist_ok=True)
    for part in options.only or parts:
        parts[part](options.folder)
    files = sorted(DATA.glob("*.h5"))
    sums = [f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}" for path in files]
    (DATA / "SHA256SUMS").write_text("\n".join(sums) + "\n")
    print(f"{len(files)} files, {sum(p.stat().st_size for p in files) / 1e6:.1f} MB in all")


if __name__ == "__main__":
    main()
