"""The colour grid of the paper: coloured square blocks on black, every window unique."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from retrue.errors import InputError, in_brief
from retrue.geometry.arrays import FloatArray, finite_array, whole_numbers, whole_size
from retrue.ranges import require_number
from retrue.shown import ShortRepr, Shown

PAPER_COLORS = (
    (255, 0, 0),
    (0, 255, 0),
    (0, 0, 255),
    (255, 255, 255),
    (0, 255, 255),
    (255, 0, 255),
    (255, 255, 0),
)
"""Red, green, blue, white, cyan, magenta, yellow: the seven of Zhang, Li, Wu 2007."""

FEWEST_WITH_LONELY_WHITE = 5  # colours: of fewer, too few choices would be left
BLOCK_IN_CAMERA_PX = 9.4  # a side of 7 to 12 is read best
BLOCK_SHARE = 0.63  # of the pitch: the rest is gap, wide enough to keep the blocks apart when out of focus


@dataclass(frozen=True, slots=True, repr=False)
class ColorGrid(ShortRepr):
    """A colour grid, as a spec; the centre of block (r, c) lies at projector pixel origin + pitch * (c, r).

    Attributes
    ----------
    projector_size : (width, height).
    colors : red, green, blue, 0 .. 255, of each colour.
    pitch, block : distance between block centres, and side of a block, in projector pixels.
    origin : projector pixel (x, y) of the centre of block (0, 0).
    code : rows of indices into `colors`.
    distance : in how many cells any two 3x3 windows differ at least, in all four rotations; None: not known.
    """

    projector_size: tuple[int, int]
    colors: tuple[tuple[int, int, int], ...]
    pitch: float
    block: float
    origin: tuple[float, float]
    code: tuple[tuple[int, ...], ...]
    distance: int | None = None

    def __post_init__(self) -> None:
        colors = whole_colors(self.colors, "colors")
        try:
            code = tuple(tuple(int(k) for k in row) for row in self.code)
        except (TypeError, ValueError, OverflowError) as error:
            raise InputError(f"code: expected rows of indices into the colours, found {in_brief(self.code)}") from error
        if not (len(code) >= 1 and len({len(row) for row in code}) == 1 and len(code[0]) >= 1):
            raise InputError("color grid: expected a code of rows of equal length")
        if not all(0 <= k < len(colors) for row in code for k in row):
            raise InputError(f"color grid: expected indices 0 .. {len(colors) - 1} in the code, one for each colour")
        for name in ("pitch", "block"):
            require_number(getattr(self, name), name, 0, above=True)
        if not 0 < self.block <= self.pitch:
            raise InputError(f"color grid: expected 0 < block <= pitch, found {self.block:g} and {self.pitch:g}")
        x, y = finite_array(self.origin, (2,), "origin")
        object.__setattr__(self, "projector_size", whole_size(self.projector_size, "projector_size"))
        object.__setattr__(self, "colors", colors)
        object.__setattr__(self, "origin", (float(x), float(y)))
        object.__setattr__(self, "code", code)

    def centres(self) -> FloatArray:
        """Projector pixels (rows, columns, 2) of the block centres."""
        column, row = np.meshgrid(np.arange(len(self.code[0])), np.arange(len(self.code)))
        centres = np.asarray(self.origin) + self.pitch * np.stack([column, row], axis=-1)
        return centres.astype(np.float64)

    def render(self) -> NDArray[np.uint8]:
        """The picture to project, (height, width, 3); a block that covers part of a pixel lights it in part.

        >>> grid = ColorGrid((6, 4), ((255, 0, 0), (0, 255, 0)), 3.0, 2.5, (1.0, 1.0), ((0, 1),))
        >>> grid.render()[1, :, 0].tolist(), grid.render()[1, :, 1].tolist()
        ([191, 255, 191, 0, 0, 0], [0, 0, 0, 191, 255, 191])
        """
        width, height = self.projector_size
        code = np.asarray(self.code)
        columns = self._coverage(width, self.origin[0], code.shape[1])
        rows = self._coverage(height, self.origin[1], code.shape[0])
        colors = np.asarray(self.colors, dtype=np.float64)
        lit = np.stack([rows.T @ colors[code, channel] @ columns for channel in range(3)], axis=-1)
        return np.floor(lit + 0.5).astype(np.uint8)

    def _coverage(self, size: int, origin: float, count: int) -> FloatArray:
        """(count, size) how much of each pixel each block covers, along one axis."""
        centre = origin + self.pitch * np.arange(count)[:, None]
        pixel = np.arange(size)
        start = np.maximum(centre - self.block / 2, pixel - 0.5)
        end = np.minimum(centre + self.block / 2, pixel + 0.5)
        return np.clip(end - start, 0.0, 1.0)

    def _shown(self) -> Shown:
        width, height = self.projector_size
        apart = "" if self.distance is None else f", windows differ in {self.distance} or more"
        return (
            f"{width} x {height} px, {len(self.code)} x {len(self.code[0])} blocks of {self.block:g} px every "
            f"{self.pitch:g} px, {len(self.colors)} colors{apart}",
            {},
        )


def grid_for_camera(projector_size: tuple[int, int], magnification: float) -> ColorGrid:
    """A colour grid over all of the projector's picture, whose blocks a camera sees BLOCK_IN_CAMERA_PX wide.

    Below some 7 camera pixels blocks run into each other; above 12 fewer fit in than could.

    Parameters
    ----------
    magnification : camera pixels that a projector pixel covers on the scene.

    >>> grid_for_camera((1024, 768), 640 / 1024).block
    15
    """
    if not magnification > 0:
        raise InputError(f"magnification: expected camera pixels a projector pixel, found {magnification}")
    block = max(round(BLOCK_IN_CAMERA_PX / magnification), 1)
    pitch = max(round(block / BLOCK_SHARE), block + 1)
    columns, rows = ((side - block) // pitch + 1 for side in projector_size)
    if not min(columns, rows) >= 3:
        raise InputError(f"color grid: blocks of {block} px leave room for {columns} x {rows}: move the camera closer")
    return make_color_grid(projector_size, rows, columns, pitch=pitch, block=block)


def whole_colors(value: ArrayLike, name: str) -> tuple[tuple[int, int, int], ...]:
    """Rows of red, green and blue, 0 .. 255, as a pattern keeps them; an `InputError` that names them otherwise."""
    colors = whole_numbers(value, (None, 3), name)
    if not ((colors >= 0) & (colors <= 255)).all():
        raise InputError(f"{name}: expected red, green and blue of 0 to 255, found {in_brief(value)}")
    return tuple((red, green, blue) for red, green, blue in colors.tolist())


def make_color_grid(
    projector_size: tuple[int, int] = (1024, 768),
    rows: int = 40,
    columns: int = 51,
    colors: tuple[tuple[int, int, int], ...] = PAPER_COLORS,
    pitch: int | None = None,
    block: int | None = None,
    gap: int | None = None,
    seed: int = 0,
    window: int = 3,
) -> ColorGrid:
    """A colour grid in the middle of the projector's picture; the same arguments give the same grid, always.

    Any two 3x3 windows, each in any of its four rotations, differ in at least `distance` cells of the result, as
    many as can be had; side neighbours differ in colour, the colours are used evenly, and of five colours or more no
    white block touches another, not even at a corner.

    Parameters
    ----------
    projector_size : (width, height) in pixels.
    rows, columns : of blocks.
    colors : red, green, blue of each, 0 .. 255; three or more.
    pitch, block, gap : in projector pixels, pitch = block + gap; the largest pitch that fits, by default.
    seed : of the random choice.
    window : side of the windows; 3 is what the decoder reads.

    Raises
    ------
    InputError
        where the grid does not fit the projector, or so many unique windows cannot be had of these colours.
    """
    width, height = projector_size = whole_size(projector_size, "projector_size")
    for name, number, least in (("rows", rows, 1), ("columns", columns, 1), ("window", window, 1), ("seed", seed, 0)):
        require_number(number, name, least, whole=True)
    for name, number in (("pitch", pitch), ("block", block), ("gap", gap)):
        if number is not None:
            require_number(number, name, 0, whole=True)
    colors = whole_colors(colors, "colors")
    if not (min(rows, columns) >= window and window == 3):
        raise InputError(f"color grid: expected windows of 3 x 3 in 3 x 3 blocks or more, found {rows} x {columns}")
    if len(colors) < 3 or len(set(colors)) != len(colors):
        raise InputError(f"color grid: expected three or more different colours, found {len(set(colors))}")
    if pitch is None:
        pitch = block + gap if block is not None and gap is not None else min(width // columns, height // rows)
    if block is None:
        block = pitch - gap if gap is not None else round(BLOCK_SHARE * pitch)
    if gap is not None and block + gap != pitch:
        raise InputError(f"color grid: expected pitch = block + gap, found {pitch} and {block} + {gap}")
    needed = ((columns - 1) * pitch + block, (rows - 1) * pitch + block)
    if not (0 < block < pitch and needed[0] <= width and needed[1] <= height):
        raise InputError(
            f"color grid: expected {columns} x {rows} blocks of {block} px every {pitch} px to fit "
            f"{width} x {height} with gaps between; use fewer or smaller blocks"
        )
    white = next(
        (i for i, color in enumerate(colors) if min(color) == 255 and len(colors) >= FEWEST_WITH_LONELY_WHITE), None
    )
    from retrue.patterns.color_grid_code import make_code  # who reads a grid needs no maker

    code, distance = make_code(rows, columns, len(colors), seed, lonely=white)
    # A block's sides lie between pixels: its first pixel is a whole number.
    origin = tuple((size - need) // 2 + (block - 1) / 2 for size, need in zip(projector_size, needed, strict=True))
    return ColorGrid(
        projector_size=projector_size,
        colors=colors,
        pitch=pitch,
        block=block,
        origin=(origin[0], origin[1]),
        code=tuple(tuple(row) for row in code.tolist()),
        distance=distance,
    )
