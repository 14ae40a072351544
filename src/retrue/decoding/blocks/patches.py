"""What the picture shows where a block should be: is there a whole one, and where exactly?"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from retrue.decoding.blocks.sampling import PICTURES, bilinear, in_two_threads
from retrue.geometry.arrays import FloatArray, Image
from retrue.geometry.compiling import MATRIX, OUT_MATRIX, called, compiled, numba

SAMPLES = 15  # along a side of a patch
REACH = 0.56  # pitches from the middle of a patch to its sides
FARTHEST = 0.06  # pitches from where the surface would have the block
STRETCH = 0.25  # of its sides
SKEW = 0.12  # pitches
UNEVEN = 0.3  # of the step from block to gap, within the block
SIDE_RANGE = 0.13  # pitches within which a side is looked for


@dataclass(frozen=True, slots=True, eq=False)
class Patches:
    """What the picture shows at N predicted blocks.

    Attributes
    ----------
    light : (N, 3) what the middle of the block adds to the darkest place of its pitch.
    offset : (N, 2) of the block from the prediction, along u and v in pitches; NaN where a side is missing.
    stretch : (N, 2) width and height over the expected ones, minus one.
    skew : (N,) largest distance between the two halves of one side, in pitches.
    uneven : (N,) 90th percentile of the distance from the middle's colour, in steps from block to gap.
    """

    light: FloatArray
    offset: FloatArray
    stretch: FloatArray
    skew: FloatArray
    uneven: FloatArray

    def misfit(self) -> FloatArray:
        """(N,) how unlike one whole block, where it should be, each is: sum of squares over their usual limits.

        NaN where a side is missing.
        """
        offset, stretch = np.abs(self.offset).max(axis=1) / FARTHEST, np.abs(self.stretch).max(axis=1) / STRETCH
        return offset**2 + stretch**2 + (self.skew / SKEW) ** 2 + (self.uneven / UNEVEN) ** 2


def look_at(picture: Image, p: FloatArray, u: FloatArray, v: FloatArray, duty: float) -> Patches:
    """Blocks at p (N, 2) with pitches u and v; a side is where the colour turns half way into another one.

    The other colour is that of the gap, or of whatever hides the gap: only the block's own colour is known.
    """
    found = np.full((len(p), 9), np.nan)
    in_two_threads(lambda n: _look_at(picture, p[n], u[n], v[n], duty, found[n]), len(p))
    return Patches(found[:, :3], found[:, 3:5], found[:, 5:7], found[:, 7], found[:, 8])


@called
def _apart(color: FloatArray, red: float, green: float, blue: float) -> float:
    return np.sqrt((color[0] - red) ** 2 + (color[1] - green) ** 2 + (color[2] - blue) ** 2)


@compiled(numba.float64(numba.types.Array(numba.float64, 1, "A"), numba.float64, numba.float64))
def _side(change: FloatArray, spacing: float, half: float) -> float:
    """Where a profile, from the middle outwards, rises half way to another colour, about `half` from there; or NaN."""
    inside, count, outside = 0.0, 0, 0.0
    for i in range(len(change)):
        if i * spacing < 0.6 * half:
            inside += change[i]
            count += 1
        elif i * spacing > half:
            outside = max(outside, change[i])
    inside /= count
    if not (outside > 0.5 and outside > 2 * inside):
        return np.nan
    level = (inside + outside) / 2
    first = 0
    while change[first] <= level:
        first += 1
    if first == 0:
        return np.nan
    side = spacing * (first - 1 + (level - change[first - 1]) / (change[first] - change[first - 1]))
    return side if abs(side - half) < SIDE_RANGE else np.nan


@compiled([numba.void(kind, MATRIX, MATRIX, MATRIX, numba.float64, OUT_MATRIX) for kind in PICTURES], nogil=True)
def _look_at(picture: Image, p: FloatArray, u: FloatArray, v: FloatArray, duty: float, found: FloatArray) -> None:
    """`found` (N, 9) <- light, offset, stretch, skew, uneven."""
    mid, half = SAMPLES // 2, duty / 2
    spacing = REACH / mid
    patch, lines = np.empty((SAMPLES, SAMPLES, 3)), np.empty((2, 2, SAMPLES, 3))
    change, color = np.empty(SAMPLES), np.empty(3)
    inner, core, across = int(0.55 * half / spacing), int(0.75 * half / spacing), int(0.8 * half / spacing)
    values, apart = np.empty((2 * inner + 1) ** 2), np.empty((2 * core + 1) ** 2 // 10 + 1)
    share = 1 / across
    sides = np.empty((2, 2, 2))  # axis, half of the line, end
    for n in range(len(p)):
        for i in range(SAMPLES):
            for j in range(SAMPLES):
                a, b = (j - mid) * spacing, (i - mid) * spacing
                x, y = p[n, 0] + a * u[n, 0] + b * v[n, 0], p[n, 1] + a * u[n, 1] + b * v[n, 1]
                patch[i, j, 0], patch[i, j, 1], patch[i, j, 2] = bilinear(picture, x, y)
        step = 1e-6
        for c in range(3):
            k, floor = 0, np.inf
            for i in range(SAMPLES):
                for j in range(SAMPLES):
                    floor = min(floor, patch[i, j, c])
            for i in range(mid - inner, mid + inner + 1):
                for j in range(mid - inner, mid + inner + 1):
                    slot = k
                    while slot > 0 and values[slot - 1] > patch[i, j, c]:  # so few are sorted fastest as they come
                        values[slot] = values[slot - 1]
                        slot -= 1
                    values[slot] = patch[i, j, c]
                    k += 1
            color[c] = values[len(values) // 2]
            found[n, c] = color[c] - floor
            step += found[n, c] ** 2
        step = np.sqrt(step)
        apart[:] = 0
        for i in range(mid - core, mid + core + 1):
            for j in range(mid - core, mid + core + 1):
                value, k = _apart(color, patch[i, j, 0], patch[i, j, 1], patch[i, j, 2]), len(apart) - 1
                while k >= 0 and apart[k] < value:  # keep the largest tenth, in order
                    if k < len(apart) - 1:
                        apart[k + 1] = apart[k]
                    k -= 1
                if k < len(apart) - 1:
                    apart[k + 1] = value
        found[n, 8] = apart[-1] / step
        lines[:] = 0  # sums over `across` lines
        for i in range(SAMPLES):
            for k in range(1, across + 1):
                for c in range(3):
                    lines[0, 0, i, c] += patch[mid - k, i, c]
                    lines[0, 1, i, c] += patch[mid + k, i, c]
                    lines[1, 0, i, c] += patch[i, mid - k, c]
                    lines[1, 1, i, c] += patch[i, mid + k, c]
        found[n, 7] = 0
        for axis in range(2):
            for part in range(2):
                for i in range(SAMPLES):
                    red, green, blue = lines[axis, part, i, 0], lines[axis, part, i, 1], lines[axis, part, i, 2]
                    change[i] = _apart(color, red * share, green * share, blue * share) / step
                sides[axis, part, 0] = _side(change[mid:], spacing, half)
                sides[axis, part, 1] = _side(change[mid::-1], spacing, half)
            after = (sides[axis, 0, 0] + sides[axis, 1, 0]) / 2
            before = (sides[axis, 0, 1] + sides[axis, 1, 1]) / 2
            found[n, 3 + axis] = (after - before) / 2
            found[n, 5 + axis] = (after + before) / duty - 1
            for end in range(2):
                skew = abs(sides[axis, 0, end] - sides[axis, 1, end])
                if not skew <= found[n, 7]:
                    found[n, 7] = skew
