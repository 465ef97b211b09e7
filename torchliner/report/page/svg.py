"""Matplotlib figures as inline SVG whose black is the page's ink and whose white is its paper."""

from __future__ import annotations

import io
import re
import warnings
from typing import Any

from torchliner.report.figure import COLOURS, require_matplotlib

INKS = dict(zip(COLOURS, ("blue", "vermilion", "green", "purple", "sky", "orange"), strict=False))
GREY = re.compile(r"(fill|stroke): #([0-9a-f]{2})\2\2(?![0-9a-f])")


def inline_svg(figure: Any, name: str) -> str:
    """The ``<svg>`` element, without title, comments and metadata, its ids beginning with ``name``.

    Greys become the page's ink, thinned; glyphs are outlines, so no font is needed.
    """
    figure.suptitle("")
    file = io.StringIO()
    settings = {"svg.hashsalt": name, "svg.fonttype": "path"}
    with require_matplotlib().rc_context(settings), warnings.catch_warnings():
        # Names in scripts that no font at hand has are boxes here and text in table and caption.
        warnings.filterwarnings("ignore", "Glyph .* missing from font")
        figure.savefig(file, format="svg", transparent=True, bbox_inches="tight", pad_inches=0.02,
                       metadata={"Date": None})  # fmt: skip
    text = file.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<!--.*?-->|<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r'\bid="([^"]*)"', rf'id="{name}-\1"', text)
    text = re.sub(r'(href="|url\()#', rf"\1#{name}-", text)
    text = GREY.sub(_ink, text)
    for colour, ink in INKS.items():
        text = text.replace(f": {colour.lower()}", f": var(--{ink})")
    return re.sub(r"<svg [^>]*?(viewBox=\"[^\"]*\")[^>]*>", _head, text, count=1)


def _ink(found: re.Match[str]) -> str:
    kind, level = found[1], int(found[2], 16)
    if level == 255:
        return f"{kind}: var(--paper)"
    thin = "" if level == 0 else f"; {kind}-opacity: {1 - level / 255:.2f}"
    return f"{kind}: currentColor{thin}"


def _head(found: re.Match[str]) -> str:
    width = float(found[1].split()[2])
    return (
        f'<svg {found[1]} xmlns:xlink="http://www.w3.org/1999/xlink" aria-hidden="true" '
        f'focusable="false" style="max-width: {width / 72:.2f}in">'
    )
