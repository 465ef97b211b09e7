"""Pages of the reference, one a group of public names; every public name stands in one group.

Each page begins with an example that uses all of its names: ``docs/examples``, run by the tests.
"""

from __future__ import annotations

import inspect
from pathlib import Path

import torchliner as tl

GROUPS: dict[str, tuple[str, str]] = {
    "Planes and maps": (
        "From velocity to impedance: read a plane, educe it, keep what comes out.",
        "VelocityPlane read_plane educe ImpedanceMap read_map onto_grid VelocityGrid",
    ),
    "Moments": (
        "A plane reduced to moments of the speed, from which any liner follows at any frequency.",
        "moments Moments GrowingMoments read_moments",
    ),
    "Liners": (
        "Models of a liner, presets and files; calibration against known impedances.",
        "load_liner preset_names SDoFLiner EndLossSDoFLiner AdjustedSDoFLiner LayeredLiner Cavity "
        "sheet TabulatedLiner goodrich_resistance sensitivities calibrate identify",
    ),
    "Laser Doppler": (
        "From bursts to an impedance line.",
        "BurstRecord read_bursts list_stations validate_bursts "
        "burst_moments educe_bursts ImpedanceLine read_line tone_attenuation",
    ),
    "Pressures": (
        "In situ pressures, and microphones along the wall.",
        "PressureRecord read_pressure in_situ decompose_waves PointImpedances read_points "
        "MicrophoneLine read_microphones WallEduction kumaresan_tufts two_wave_fit sort_waves "
        "fit_field FieldFit read_wall",
    ),
    "Time domain": (
        "A liner as poles and residues, stable and passive, for solvers in the time domain.",
        "fit_multipole Multipole",
    ),
    "Duct": (
        "Sound in a lined duct with flow: dispersion relation, modes, linearised Euler equations.",
        "load_duct DuctSolver solve_settled duct_modes impedance_from_wavenumber "
        "wavenumber_from_impedance TanhProfile TabulatedProfile",
    ),
    "Incident wave alone": (
        "No velocity measured: a wave of a stated level drives the liner.",
        "ir_tdibc LevelCurve",
    ),
    "Signals": (
        "Incident signals other than one tone, the kernels that replay them, and the reflected signal.",
        "replay Tones Sweep BandNoise Recorded read_signal build_kernels",
    ),
    "Reliability": (
        "How far each choice moves a result; results and models compared; figures for print.",
        "audit compare compare_models DataWarning",
    ),
    "Conversions": (
        "Air, and the arithmetic between reflection, impedance and absorption.",
        "Fluid reflection_from_impedance impedance_from_reflection absorption_from_reflection",
    ),
}


def check_groups() -> None:
    """Raises ValueError with the names that no group holds, or that two do, or that are gone."""
    listed = [name for _, names in GROUPS.values() for name in names.split()]
    public = set(tl.__all__) - {"__version__"}
    wrong = {n for n in listed if listed.count(n) > 1} | (public ^ set(listed))
    if wrong:
        raise ValueError(f"docs/reference.py: not once in the groups: {', '.join(sorted(wrong))}")


def _entry(name: str) -> str:
    """Directive of a public name, called as its users call it."""
    kind = "autoclass" if inspect.isclass(getattr(tl, name)) else "autofunction"
    if kind == "autoclass" and issubclass(getattr(tl, name), Warning):
        return f".. autoexception:: torchliner.{name}\n"
    members = "   :members:\n   :inherited-members: object\n" if kind == "autoclass" else ""
    return f".. {kind}:: torchliner.{name}\n{members}"


def write_reference(folder: Path) -> None:
    """One page a group and an index with all names, in reStructuredText."""
    check_groups()
    folder.mkdir(exist_ok=True)
    parts = ["Reference\n=========\n", "Every public name, as ``tl.NAME`` after ``import torchliner as tl``.\n"]
    pages = []
    for title, (about, names) in GROUPS.items():
        page = title.lower().replace(" ", "_")
        pages.append(f"   {page}")
        entries = "\n".join(_entry(name) for name in names.split())
        text = f"{title}\n{'=' * len(title)}\n\n{about}\n\n.. literalinclude:: ../examples/{page}.py\n\n"
        _write(folder / f"{page}.rst", text + entries)
        links = ", ".join(f":py:obj:`{n} <torchliner.{n}>`" for n in names.split())
        parts.append(f":doc:`{page}`: {about} {links}\n")
    parts.append(".. toctree::\n   :hidden:\n\n" + "\n".join(pages) + "\n")
    _write(folder / "index.rst", "\n".join(parts))


def _write(path: Path, text: str) -> None:
    """Left alone where it holds this text, so that Sphinx need not read it again."""
    if not path.exists() or path.read_text() != text:
        path.write_text(text)
