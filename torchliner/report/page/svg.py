"""Matplotlib figures as inline SVG."""

from __future__ import annotations

import io
import re
import warnings
from typing import Any

from torchliner.report.figure import require_matplotlib


def inline_svg(figure: Any, name: str) -> str:
    """The ``<svg>`` element, without title, comments and metadata, its ids beginning with ``name``.

    Glyphs are outlines, so no font is needed; the page shows it on white, in the dark too.
    """
    figure.suptitle("")
    file, settings = io.StringIO(), {"svg.hashsalt": name, "svg.fonttype": "path"}
    with require_matplotlib().rc_context(settings), warnings.catch_warnings():
        # Names in scripts that no font at hand has are boxes here and text in table and caption.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(file, format="svg", bbox_inches="tight", pad_inches=0.02, metadata={"Date": None})
    text = file.getvalue()
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text[text.index("<svg") :], flags=re.DOTALL)
    text = re.sub(r'\bid="([^"]*)"', rf'id="{name}-\1"', text)
    text = re.sub(r'(href="|url\()#', rf"\1#{name}-", text)
    return re.sub(r"<svg [^>]*?(viewBox=\"[^\"]*\")[^>]*>", _head, text, count=1)


def _head(found: re.Match[str]) -> str:
    width = float(found[1].split()[2])
    return (
        f'<svg {found[1]} xmlns:xlink="http://www.w3.org/1999/xlink" aria-hidden="true" '
        f'focusable="false" style="max-width: {width / 72:.2f}in">'
    )
