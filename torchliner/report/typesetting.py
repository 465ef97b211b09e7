"""Words for print: what is a minus, and what is the hyphen of a date, a range or a name."""

from __future__ import annotations

import re

MINUS, PRIME = "\N{MINUS SIGN}", "\N{PRIME}"
REAL = r"(?:inf|\d+(?:\.\d*)?(?:e[+-]?\d+)?|\.\d+(?:e[+-]?\d+)?)"
# Nothing before it that makes it part of a name, a formula or a range; nothing behind it that makes
# it part of a date (2026-01-02), a range (300-3500), a file (-3.h5) or a word.
NUMBER = re.compile(
    rf"(?P<option>--[a-z][\w-]*[ =]-{REAL})"  # is typed as it stands
    rf"|(?<![\w.)\]}}$^{{/-])-?{REAL}(?:[+-]{REAL}j|j)?(?!\w|\.\w|-\w)"
)
FLUCTUATION = re.compile(r"(?<=[uv])(?<![\w$'][uv])'")  # of u' and v', not the quotes of 'v'
HEIGHT = re.compile(r"(?<!\$)\by = (?=[\d.])")


def typeset(text: str) -> str:
    """The same with a true minus in every number, exponents included, and true primes.

    Hyphens of dates, ranges, file names, command-line options and formulas stay.
    """
    text = NUMBER.sub(lambda n: n[0] if n["option"] else n[0].replace("-", MINUS), text)
    return FLUCTUATION.sub(PRIME, text)


def typeset_label(text: str) -> str:
    """The same for what matplotlib draws: the height's symbol is that of the axes."""
    return HEIGHT.sub("$y$ = ", typeset(text))
