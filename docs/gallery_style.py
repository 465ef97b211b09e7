"""What the gallery's pictures look like: as the figures of the package."""

from __future__ import annotations

from typing import Any

from torchliner.report.figure import COLOURS, STYLE


def apply(gallery_conf: Any = None, script: str = "") -> None:
    """Before each script, after matplotlib's own settings are back."""
    import matplotlib

    matplotlib.rcParams.update(matplotlib.rc_params_from_file(STYLE, use_default_template=False))
    matplotlib.rcParams.update(
        {
            "figure.figsize": (5.3, 3.3),
            "axes.titlelocation": "left",
            "lines.markersize": 4,
            "axes.prop_cycle": matplotlib.cycler(color=COLOURS[:7]),
            "savefig.dpi": 150,
        }
    )
