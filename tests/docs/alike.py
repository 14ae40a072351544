"""Whether an example prints, and draws, what the page says.

Words must be the same. Figures may differ as much as they do between machines and releases of the libraries below;
times may differ at will.
"""

from __future__ import annotations

import re
from itertools import zip_longest
from pathlib import Path

import numpy as np
from PIL import Image

TIME = re.compile(
    r"\d{4}-\d\d-\d\d[ T]\d\d:\d\d:\d\d(\.\d+)?(\+\d\d:\d\d)?|\d+(\.\d+)? (s|ms|us)\b|(?<=seconds\": )[\d.]+"
)
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")
RELATIVE = 0.03
LAST_DIGITS = 3  # units of the last digit that is shown
EXACT_BELOW = 100  # counts
PICTURE_LEVELS = 4.0  # grey levels, RMS
AFAR = (60, 45)


def same_text(shown: str, printed: str, exact: bool = False) -> bool:
    """Whether the output is as shown, all figures but times if `exact`; a line `...` stands for any lines."""
    expected = [re.escape(part.strip()) for part in re.split(r"^\.\.\.$", _plain(shown), flags=re.MULTILINE)]
    if not re.fullmatch(
        r"\s*.*\s*".join(_blank_tolerant(part) for part in expected), _plain(printed).strip(), re.DOTALL
    ):
        return False
    return len(expected) > 1 or _same_numbers(shown, printed, exact)


def same_picture(first: Path, second: Path) -> bool:
    """Whether two pictures look alike from afar, whatever their size in pixels."""
    a, b = (_from_afar(path) for path in (first, second))
    return float(np.sqrt(np.mean((a - b) ** 2))) < PICTURE_LEVELS


def _plain(text: str) -> str:
    """Times and numbers made alike, and runs of blanks one blank."""
    return re.sub(r"[ \t]+", " ", NUMBER.sub("0", TIME.sub("TIME", text))).replace(" \n", "\n")


def _blank_tolerant(escaped: str) -> str:
    return re.sub(r"(\\ |\\\n)+", r"\\s+", escaped)


def _same_numbers(shown: str, printed: str, exact: bool) -> bool:
    pairs = zip_longest(*(NUMBER.findall(TIME.sub("TIME", text)) for text in (shown, printed)), fillvalue="nan")
    return all(a == b if exact else _close(a, b) for a, b in pairs)


def _close(shown: str, printed: str) -> bool:
    expected, found = float(shown), float(printed)
    if "." not in shown and abs(expected) < EXACT_BELOW:
        return expected == found
    digits = len(shown.partition("e")[0].partition(".")[2])
    unit = 10.0**-digits
    return abs(expected - found) <= max(RELATIVE * abs(expected), LAST_DIGITS * unit)


def _from_afar(path: Path) -> np.ndarray:
    with Image.open(path) as picture:
        return np.asarray(picture.convert("RGB").resize(AFAR, Image.Resampling.BOX), dtype=np.float64)
