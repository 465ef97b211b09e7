"""Words for print: what is a minus, and what is the hyphen of a date, a range or a name."""

from __future__ import annotations

import re

MINUS = "\N{MINUS SIGN}"
# A number that stands alone, with its imaginary part; not one within a name, a formula, a range, a date or a file.
NUMBER = re.compile(r"(?<![\w.)\]}$^{/-])-?\d[\d.]*(?:e[+-]?\d+)?(?:[+-][\d.]+(?:e[+-]?\d+)?j)?j?(?!\w|\.\w|-\w)")


def typeset(text: str) -> str:
    """The same with a true minus in every number, exponents included; other hyphens stay."""
    return NUMBER.sub(lambda found: found[0].replace("-", MINUS), text)


def typeset_label(text: str) -> str:
    """The same for what matplotlib draws: the height's symbol is that of the axes."""
    return re.sub(r"(?<!\$)\by = (?=[\d.])", "$y$ = ", typeset(text))
