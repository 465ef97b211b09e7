"""Options that several commands share, by name."""

from pathlib import Path

from torchliner import names
from torchliner.cli.options import (
    CHOICES,
    FILE,
    FOLDER,
    FREQUENCIES,
    NAME,
    NUMBER,
    PICTURE,
    TEXT,
    WALL,
    Kind,
    Of,
    Option,
)
from torchliner.io.whole_file import HDF5


def output(text: str, *endings: str, flag: str = "--output", required: bool = False) -> Option:
    """A file with one of the endings, or a folder for one with the first."""
    return Option(flag, f"{text} as {', '.join(endings)}", Kind("FILE", Path, "written", endings), required=required)


def frequency(default: str, flag: str = "--frequency", to: str = "") -> Option:
    """Values or ranges of frequency; ``default`` in words."""
    return Option(flag, f"in Hz, values or LOW:HIGH:STEP; default: {default}", FREQUENCIES, "+", to=to)


def fact(flag: str, text: str, kind: Kind | tuple[str, ...] = NUMBER) -> Option:
    """About the case, of a record that is read."""
    return Option(flag, text, kind, group="about the case (default: as the file says)", to="facts")


def choices(wanted: str) -> Of:
    """Fields of ``Choices``."""
    return Of(CHOICES, wanted, "choices")


STATED = "variable group axes velocity_units length_units sampling_rate normal row wall_normal_component x z points "
READING = (
    Of("io.planes:read_plane", "start stop every region", "part of the data", to="reading"),
    Of("io.plane_format:PlaneRequest", f"{STATED}overlap", "missing metadata", to="reading"),
)
ANY = "of any format, or moments; 'run_*.nc' joins restarts"
WAVES = "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), or a .wav file; default: --frequency"
SPL = "of the incident wave (normal incidence) or at the wall (grazing), dB re 20 uPa rms"
BASE = "drive running_window mean wall_filter missing background minimum_coherence interval level_limit "
BASE += "level_uncertainty level_matched allow_short device dtype"
SHARED: dict[str, tuple[Option | Of, ...]] = {
    "plane": (Option("plane", f"file of a plane, {ANY}", FILE), *READING),
    "planes": (Option("planes", f"files of planes, {ANY}", FILE, "+"), *READING),
    "stated": READING[1:],
    "bursts": (
        Option("source", "file of bursts, or folder of stations", FILE),
        Of("io.burst_text:read_burst_columns", "columns separator", to="reading"),
        Of("io.burst_text:read_dantec", "components", to="reading"),
    ),
    "liner": (
        Option("--liner", "preset, or .toml, .csv or .py file of a model; default: the one the file names", NAME),
    ),
    "tone": (frequency("the tone of the file"),),
    "one-tone": (Option("--frequency", "in Hz; default: the tone of the file", NUMBER),),
    "incident": (Option("--incident", WAVES, NAME),),
    "rows": (output("write the rows", ".csv"),),
    "plane-file": (output("write it", *HDF5, required=True),),
    "map": (output("write the result (of several planes, their names are appended)", *HDF5, *names.RESULT_WRITERS),),
    "law": (output("write the liner", ".toml"),),
    "copy": (output("write the preset, to edit,", ".toml", flag="--copy"),),
    "figure": (Option("--figure", "draw the result there", PICTURE),),
    "figures": (Option("--figure", "draw pictures there", FOLDER),),
    "strict": (Option("--strict", "exit code 1 where the level check fails for the answer"),),
    "seen": (fact("--incident-level", SPL), fact("--source-side", "that the sound comes from", names.SOURCE_SIDES)),
    "case": (
        *(fact("--frequency", "tone in Hz"), fact("--mach", "bulk Mach number")),
        *(fact("--displacement-thickness", "of the boundary layer, m"), fact("--title", "of tables and figures", TEXT)),
    ),
    "place": (fact("--x", "of the station, m"), fact("--y", "above the liner, m"), fact("--z", "across the duct, m")),
    "below": (fact("--liner", "name of the liner below", TEXT),),
    "educed": (choices("averaging phase"), Of("velocity.educe:educe", "reference_phase", "choices"), choices(BASE)),
    "base": (choices(BASE),),
    "filters": (Option("--without", "switch off filters of bursts; default: none", names.FILTERS, "+", []),),
    "duct": (
        Option("--liner", "preset, .toml, .csv or .py file: Z(f) of a liner; default: --impedance", NAME),
        Option("--speed", "|v| at the liner, rms, m/s, with --liner; default 0", NUMBER, default=0.0),
        frequency("the duct's", to="chosen"),
        Option("--bulk-mach", "Mach number of the flow; default: the duct's", NUMBER, to="chosen"),
        Option("--profile", "of the flow; default: the duct's", names.FLOW_PROFILES, to="chosen"),
        Option("--shear", "of --profile tanh, half heights; default: the duct's", NUMBER, to="chosen"),
        Option("--impedance", "R+Xj or rigid, one a lined patch; default: the duct's", WALL, "+", to="chosen"),
    ),
    "fit": (
        Option(
            "--reference",
            "impedance named in the files, or one each, as 0.168-0.066j; default true",
            TEXT,
            "+",
            ["true"],
        ),
        Option("--predict", "planes to predict; default: none", FILE, "+", []),
        Option("--noise", "standard uncertainty of R and X of the references", NUMBER),
    ),
    "fixed": (choices("drive mean missing allow_short"),),
}
