"""All commands: the function of each, the options that it shares with others, and its own."""

import re
from pathlib import Path

from torchliner import names
from torchliner.cli.kinds import BOUNDS, COMPLEX, COUNT, FREQUENCIES, NUMBER, REFERENCE, TEXT, TOLERANCES, WALL, Kind
from torchliner.cli.options import CHOICES, FILE, FOLDER, NAME, PICTURE, Command, Of, Option
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


STATED = "variable group axes velocity_units length_units sampling_rate normal wall_normal_component x z points "
READING = (
    Of("io.planes:read_plane", "start stop", "part of the data", to="reading"),
    Of("io.plane_format:PlaneRequest", f"{STATED}overlap", "missing metadata", to="reading"),
)
ANY = "of any format (most commands also take moments); 'run_*.nc' joins restarts"
WAVES = "tones:500,900, sweep:300:6000:logarithmic, noise:300:6000:SEED (Hz), or a .wav file; default: --frequency"
SPL = "of the incident wave (normal incidence) or at the wall (grazing), dB re 20 uPa rms"
BASE = "drive running_window mean wall_filter missing background minimum_coherence interval level_limit "
BASE += "level_uncertainty level_matched allow_short device dtype"
FIXED = "drive mean missing allow_short"
KNOWN = "name of the known impedance in the files, or a value for each, as 0.168-0.066j"
SHARED: dict[str, tuple[Option | Of, ...]] = {
    "plane": (Option("plane", f"file of a plane, {ANY}", FILE), *READING),
    "planes": (Option("planes", f"files of planes, {ANY}", FILE, "+"), *READING),
    "stated": READING[1:],
    "bursts": (
        Option("source", "file of bursts, or folder of stations", FILE),
        Of("io.burst_text:read_burst_columns", "columns separator", to="reading"),
        Of("io.burst_text:read_dantec", "components", to="reading"),
    ),
    "liner": (Option("--liner", "preset, .toml, .csv or .py file; default: as the file says", NAME),),
    "tone": (frequency("the tone of the file"),),
    "one-tone": (Option("--frequency", "in Hz; default: the tone of the file", NUMBER),),
    "incident": (Option("--incident", WAVES, NAME),),
    "rows": (output("write the rows", ".csv"),),
    "plane-file": (output("write the result", *HDF5, required=True),),
    "map": (output("write the result (of several planes, their names are appended)", *HDF5, *names.RESULT_WRITERS),),
    "law": (output("write the liner", ".toml"),),
    "copy": (output("write the preset, to edit,", ".toml", flag="--copy"),),
    "figure": (Option("--figure", "draw the result there; in a folder all pictures, with their numbers", PICTURE),),
    "strict": (Option("--strict", "exit code 1 where the level check fails for the answer"),),
    "seen": (fact("--incident-level", SPL), fact("--source-side", "side of the source", names.SOURCE_SIDES)),
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
        Option("--reference", f"{KNOWN}; default 'true'", REFERENCE, "+", ["true"]),
        Option("--predict", "planes to predict; default: none", FILE, "+", []),
        Option("--noise", "standard uncertainty of R and X of the references", NUMBER),
    ),
    "fixed": (choices(FIXED),),
}
FREE = "parameter to fit and its bounds, SI, or usual ones; 'offset' is both parts. Without, for runs without flow: "
FREE += "contraction coefficient, with two levels or more the offset, and the law of lost mass that predicts best"
LAWS = "a model: 'curve', a free curve over |v|; or parameters of the liner's law, with commas between, each with its "
LAWS += "bounds (NAME=LOW:HIGH, SI) or usual ones; several times to compare; default: curve"
TOLERANCE = "half-width, SI, e.g. orifice_diameter=2e-5; without, the change of Z for 1 % of each parameter"
METHODS = "; ".join(f"{name}, {text}" for name, (_, text, _) in names.WALL_METHODS.items())
KT, IR = "pressure.waves:kumaresan_tufts", "velocity.ir_tdibc:ir_tdibc"
BURSTS = "method grid_rate band_limit correction segment overlap window flagged monte_carlo"
OF_BURSTS = {"method": names.GRID_METHODS, "overlap": NUMBER, "window": names.STATION_WINDOWS}


def row(shared: str, *own: Option | Of) -> list[Option | Of]:
    """The options of a command: its own, and shared ones by name."""
    return [*own, *(each for name in shared.split() for each in SHARED[name])]


# By module of this folder; a command's function has its name.
GROUPS = {
    ("velocity", "educe an impedance from velocity above the liner"): {
        "educe": row(
            "planes liner tone map figure strict seen educed",
            Option("--in-situ", "pressure record, whose impedance is added to the results", FILE),
            Option("--wall-pressure", "pressure record for the level check; default: --in-situ", FILE),
        ),
        "replay": row(
            "plane liner incident map figure strict",
            frequency("the tone of the file, or the lines of --incident"),
            output("write the reflected signals", *HDF5, flag="--reflected"),
            Of("velocity.replay:replay", "averaging mean missing interval device dtype"),
            Of("velocity.replay:replay", "kernel levels spacing interpolation velocity_max window segment"),
        ),
        "ldv info": row("bursts rows filters seen case place below"),
        "ldv educe": row(
            "bursts liner map figure filters seen case place",
            frequency("the tone", "--educe-at"),
            Of("bursts.station:StationChoices", BURSTS, "from bursts to segments", OF_BURSTS),
            choices("phase drive running_window mean minimum_coherence interval device dtype"),
        ),
    },
    ("studies", "vary a choice, a height, a model or its parameters, or fit these"): {
        "audit": row("planes liner one-tone rows figure base", Of("studies.audit:audit", "averaging", "choices")),
        "height": row("planes liner one-tone rows figure", choices(f"averaging phase {FIXED} wall_filter")),
        "compare": row(
            "rows figure",
            Option("first", "map of torchliner educe", FILE),
            Option("second", "map of the same cells", FILE),
            Of("studies.compare:compare", "averaging"),
        ),
        "compare-models": row(
            "plane tone rows figure educed",
            Option("--liner", "preset, .toml, .csv or .py file; twice or more", NAME, many=True, required=True),
        ),
        "sensitivity": row(
            "plane liner tone rows fixed",
            Option("--averaging", "over cells; default velocity", names.AVERAGINGS, default="velocity"),
            Option("--tolerance", TOLERANCE, TOLERANCES, many=True),
            Option("--parameters", "of the liner, e.g. porosity; default: all", TEXT, "+"),
        ),
        "calibrate": row(
            "planes liner law figure fit fixed",
            Option("--free", FREE, BOUNDS, many=True),
            Option("--averaging", "over cells; default velocity, without --free phase-locked", names.AVERAGINGS),
        ),
        "identify": row(
            "planes liner tone law figure fit fixed",
            Option("--free", LAWS, BOUNDS, many=True),
            Of("studies.calibrate:identify", "averaging rest freedom"),
        ),
    },
    ("models", "measure an impedance from pressure; model a liner or a duct"): {
        "insitu": row(
            "tone figure",
            Option("record", "pressure record", FILE),
            output("write the rows as .csv, or points, cells and surface,", ".csv", *HDF5),
            Option("--microphones", "two of the row, counted from 0; default: the best conditioned pair", COUNT, 2),
            Of("pressure.dean:in_situ", "losses"),
            Of("pressure.tones:Tones", "start window segment", kinds={"window": names.WINDOWS}),
            choices("allow_short interval"),
        ),
        "kt": row(
            "figure",
            Option("lines", "microphone lines: .csv, .h5 or .nc", FILE, "+"),
            Option("--method", f"{METHODS}; default kt", names.WALL_METHODS, default="kt"),
            frequency("those of the file"),
            output("write the rows as .csv, or all of the result, for torchliner report,", ".csv", *HDF5),
            Option("--segment", "of time signals, s; default: the whole record", NUMBER),
            fact("--source-side", "side of the source", names.SOURCES),
            fact("--mach", "bulk Mach number, 0 for no flow; of --method field the duct's"),
            Of("pressure.microphone_errors:MicrophoneErrors", "draws seed level_error phase_error", "error bars"),
            Of(KT, "rank order condition margin", "kt and fits of two waves"),
            Option("--duct", "preset or .toml file, of --method field", NAME, group="--method field", to="chosen"),
            Of("pressure.fit_field:fit_field", "far_end start", "--method field"),
        ),
        "liner": row(
            "figure copy",
            Option("liner", "preset, .toml, .csv or .py file (which is run); without: list the presets", NAME, "?"),
            frequency("500 to 3000 Hz"),
            Option("--speed", "|v|, m/s; default 0 1 3 5", NUMBER, "+", [0.0, 1.0, 3.0, 5.0]),
        ),
        "duct solve": row(
            "duct figure copy",
            Option("duct", "preset or .toml file; without: list the presets", NAME, "?"),
            output("write the microphones, for torchliner kt and report,", ".csv", *HDF5),
            Option("--mesh", "largest cell, and largest at walls, m; default: checked on a finer mesh", NUMBER, "+"),
            Option("--level", "of the incident wave, dB re 20 uPa rms; default: the duct's", NUMBER, to="chosen"),
            Option("--source-side", "of the sound; default: the duct's", names.SOURCES, to="chosen"),
            Option("--end-reflection", "of the far end; default: the duct's", COMPLEX, to="chosen"),
        ),
        "duct modes": row(
            "duct rows",
            Option("duct", "preset or .toml file", NAME),
            Option("--count", "modes in each direction; default 4", COUNT, default=4),
        ),
        "ir-tdibc": row(
            "rows figure",
            Option("liner", "preset, .toml, .csv or .py file", NAME),
            Option("--level", "of the whole incident wave, dB re 20 uPa rms", NUMBER, "+", required=True),
            Option(
                "--frequency", "of tones, all at once, in Hz, values or LOW:HIGH:STEP", FREQUENCIES, "+", required=True
            ),
            Of(IR, "kernel sampling_rate duration after", kinds={"kernel": names.STEP_KERNELS}),
        ),
        "export": row(
            "",
            Option("map", "map of torchliner educe, of several frequencies", FILE),
            Of("records.impedance_map:ImpedanceMap.time_domain", "poles band averaging"),
            output("write poles and residues, as coefficient lists,", ".json", ".txt"),
        ),
    },
    ("campaign", "files of planes"): {
        "info": row("plane"),
        "convert": row(
            "plane plane-file seen case below",
            fact("--height", "above the liner, m"),
        ),
        "reduce": row(
            "plane plane-file tone",
            Option("--liner", "model that the moments are for, and whose cells count; default: any liner", NAME),
            Option("--cell-pitch", "m, without --liner; default: that of the file's preset", NUMBER),
            choices("averaging phase drive running_window mean missing background allow_short device dtype"),
        ),
    },
    ("campaign", "many planes, planes that grow, pages"): {
        "run": row(
            "",
            Option("campaign", "TOML file of a campaign", FILE),
            Option("--output", "write the results there; default: as the file says, else NAME_results", FOLDER),
            Option("--dry-run", "show what would be done, and write nothing"),
            Option("--cluster", "local:N, N processes; tcp://HOST:PORT of a dask scheduler, or its .json", TEXT),
            Option("--wait", "seconds for its scheduler and its first worker; default 30", NUMBER),
        ),
        "follow": row(
            "liner tone stated",
            Option("plane", "file that grows, or folder that files come into, in the order of names", FILE),
            output("write the moments so far, however it ends,", *HDF5),
            Option("--until", "half-width of the interval of Z, over rho c, at which it ends; default: none", NUMBER),
            Option("--every", "seconds between two looks; default 5", NUMBER, default=5.0),
            Option("--idle", "seconds without new samples, after which it ends; default 600", NUMBER, default=600.0),
            Of("velocity.replay:replay", "averaging"),
            choices("phase interval dtype"),
        ),
        "report": row(
            "",
            Option("result", "file that another command wrote, or the folder of a campaign", FILE),
            output("write the page", ".html", required=True),
        ),
    },
}
COMMANDS = {
    name: Command(f"{module}:{re.sub('[ -]', '_', name)}", options)
    for (module, _), group in GROUPS.items()
    for name, options in group.items()
}
