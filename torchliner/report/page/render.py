"""One self-contained page by Jinja2."""

from __future__ import annotations

import base64
import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from importlib import resources
from pathlib import Path
from typing import Any

from torchliner.io.whole_file import printable, written_whole
from torchliner.report.figure import require_matplotlib
from torchliner.report.page.blocks import Section, shown

ENDING = ".html"


@dataclass(frozen=True)
class Page:
    """What is on a page.

    Args:
        title: its one heading.  answer: the one sentence below it.
        state: of the level check: ``passes``, ``inconclusive``, ``fails`` or "".
        sections: in order.  footer: one line.
    """

    title: str
    answer: str
    state: str
    sections: Sequence[Section]
    footer: str

    def html(self) -> str:
        """The whole page.

        Raises:
            ImportError: jinja2 or matplotlib is not installed.
        """
        home = resources.files(__package__)
        css, script = ((home / name).read_text(encoding="utf-8") for name in ("page.css", "page.js"))
        digest = base64.b64encode(hashlib.sha256(script.encode("utf-8")).digest()).decode("ascii")
        environment = require_report().Environment(
            autoescape=True, trim_blocks=True, lstrip_blocks=True, finalize=_printable
        )
        template = environment.from_string((home / "page.html").read_text(encoding="utf-8"))
        return str(template.render(
            page=self, title=shown(self.title), css=css, script=script, digest=digest,
            sections=[section for section in self.sections if section.blocks],
        ))  # fmt: skip

    def write(self, path: str | Path) -> None:
        """As one file, whole or not at all.

        Raises:
            ValueError, OSError: as ``written_whole``; another ending than .html.
        """
        with written_whole(path, ENDING) as temporary:
            temporary.write_text(self.html(), encoding="utf-8")


def _printable(value: Any) -> Any:
    """Texts without what would steer a reader's screen; our own markup as it is."""
    return printable(value) if type(value) is str else value


def require_report() -> Any:
    """The module jinja2; asked for before any work.

    Raises:
        ImportError: it or matplotlib is not installed.
    """
    require_matplotlib()
    try:
        import jinja2
    except ImportError as error:
        raise ImportError('a report needs jinja2: pip install "torchliner[report]"') from error
    return jinja2
