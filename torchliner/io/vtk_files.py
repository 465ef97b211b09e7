"""VTK files of one frame, XML or legacy: its points, faces and values.

An own reader in numpy: vtk is 500 MB for a few arrays, and reads all of a file for one of them.
"""

from __future__ import annotations

from pathlib import Path

from torchliner.io.surface_frames import Frame, read_whole
from torchliner.io.vtk_legacy import parse_legacy
from torchliner.io.vtk_xml import parse_xml


def is_vtk(head: bytes) -> bool:
    """Whether the first bytes of a file are those of VTK, of any kind of data."""
    return head.startswith(b"# vtk DataFile") or b"<VTKFile" in head[:1024]


def parse_vtk(path: Path) -> Frame:
    """What a file of one frame offers.

    Raises:
        ValueError: it is no VTK file, truncated, or of a kind that is not read.
    """
    raw = read_whole(path)
    if not is_vtk(raw[:1024]):
        raise ValueError(f"{path} begins with {raw[:20]!r}: it is no VTK file")
    return (parse_legacy if raw.startswith(b"#") else parse_xml)(raw, path)
