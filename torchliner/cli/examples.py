"""A line or two for every command, as a user would type them; ``tests/test_cli.py`` parses each."""

from __future__ import annotations

EXAMPLES = {
    "educe": (
        "plane.h5 -o map.h5 --figure pictures --holes holes.csv",
        "'run_*.nc' --normal y --frequency 300:6000:100 --liner mine.toml",
    ),
    "replay": (
        "plane.h5 --incident noise:300:3500 --segment 0.01 -o map.h5",
        "plane.h5 --kernel causal --spacing uniform --interpolation linear --window hann",
    ),
    "ldv info": ("bursts/ --json",),
    "ldv convert": ("bursts/ -o line.h5",),
    "ldv educe": ("bursts/ --frequency 1400 --liner onera -o line_z.h5",),
    "audit": ("plane.h5 --figure audit.png",),
    "height": ("plane_y*.h5 -o rows.csv --figure pictures",),
    "compare": ("first.h5 second.h5",),
    "validate": ("data/slit_n130_y*.h5 -o rules.csv",),
    "compare-models": ("plane.h5 --liner onera --liner mine.toml --figure models.png",),
    "insitu": ("pressure.h5 -o z.csv --figure z.png",),
    "kt": (
        "wall.csv --mach 0.3 --draws 500 --figure z.png",
        "wall.csv --method field --duct b2a",
        "up.csv down.csv --draws 500 -o kt.h5",
    ),
    "liner": ("onera --frequency 500:3000:500", "onera --copy mine.toml"),
    "duct solve": ("b2a --frequency 1000:2000:500 --figure field.png -o b2a.h5",),
    "duct modes": ("b2a --frequency 1400",),
    "ir-tdibc": (
        "lbm_slit --frequency 1400 --level 115 130 145 --figure z.png -o z.csv",
        "onera --incident noise:500:3000 --level 120 140 --realisations 8 --frequency 1000",
    ),
    "sensitivity": ("plane.h5 --tolerance porosity='2 %' --tolerance cavity_depth='0.1 mm'",),
    "calibrate": (
        "quiet.h5 loud.h5 --free vena_contracta=0.4:1 --noise 0.002 -o mine.toml",
        "low.h5 high.h5 --reference level-check --free vena_contracta=0.4:1",
    ),
    "identify": (
        "low.h5 mid.h5 high.h5 --rest 0.01+0.01j -o mine.toml --figure curve.png",
        "low.h5 high.h5 --free vena_contracta --free vena_contracta,mass_loss -o law.toml",
    ),
    "demo": ("",),
    "info": ("plane.h5",),
    "convert": ("'run_*.nc' -o plane.h5 --normal y",),
    "reduce": ("plane.h5 -o plane.moments.h5",),
    "export": ("map.h5 --poles 6 --band 500 3000 -o liner.json",),
    "report": (
        "map.h5 -o report.html",
        "kt.h5 -o report.html",
        "results -o campaign.html --cases",
    ),
    "run": ("campaign.toml", "campaign.toml --dry-run"),
    "follow": ("plane.h5 --until 0.05",),
}  # arguments by command, or by command and task


def examples_of(command: str) -> str:
    """The epilog of a command's help; empty for one without examples."""
    lines = [f"  torchliner {command} {words}".rstrip() for words in EXAMPLES.get(command, ())]
    return "\n".join(["examples:", *lines]) if lines else ""
