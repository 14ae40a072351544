"""What an experiment answers: a table, and the charts that show it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

Cell = str | float | int


@dataclass(frozen=True, slots=True)
class Table:
    """Rows under named columns.

    >>> print(Table("speed", ("what", "us"), [("ours", 1.25)]).text())
    speed
    what    us
    ours  1.25
    """

    name: str
    columns: tuple[str, ...]
    rows: Sequence[tuple[Cell, ...]]

    def column(self, name: str) -> list[Cell]:
        """The cells under that name."""
        index = self.columns.index(name)
        return [row[index] for row in self.rows]

    def where(self, **values: Cell) -> Table:
        """Only the rows that hold those values."""
        index = {self.columns.index(name): value for name, value in values.items()}
        rows = [row for row in self.rows if all(row[k] == value for k, value in index.items())]
        return Table(self.name, self.columns, rows)

    def csv(self) -> str:
        """With a header line; six significant digits."""
        return "\n".join(",".join(map(_cell, line)) for line in (self.columns, *self.rows)) + "\n"

    def text(self, width: int | None = None) -> str:
        """For people: aligned columns, three significant digits; folded into several blocks where it is too wide.

        >>> print(Table("speed", ("what", "us"), [("ours", 1.25)]).text(width=8))
        speed
           what
        1  ours
        <BLANKLINE>
             us
        1  1.25
        """
        columns = [self._aligned(k) for k in range(len(self.columns))]
        blocks = [columns]
        if width is not None and sum(len(column[0]) + 2 for column in columns) - 2 > width:
            blocks = _folded(columns, width)
        return "\n\n".join([f"{self.name}\n{_block(blocks[0])}", *map(_block, blocks[1:])])

    def _aligned(self, k: int) -> list[str]:
        """One column, its name above it, all of one length: words flush left, numbers flush right."""
        cells = [self.columns[k], *(_short(row[k]) for row in self.rows)]
        widest = max(map(len, cells))
        words = any(isinstance(row[k], str) for row in self.rows)
        return [cell.ljust(widest) if words else cell.rjust(widest) for cell in cells]


def _folded(columns: list[list[str]], width: int) -> list[list[list[str]]]:
    """So many columns a block as fit, each block begun by the number of the row."""
    last = len(columns[0]) - 1
    numbers = [f"{row or '':>{len(str(last))}}" for row in range(last + 1)]
    blocks, used = [[numbers]], len(numbers[0])
    for column in columns:
        used += 2 + len(column[0])
        if used > width and len(blocks[-1]) > 1:
            blocks.append([numbers])
            used = len(numbers[0]) + 2 + len(column[0])
        blocks[-1].append(column)
    return blocks


def _block(columns: list[list[str]]) -> str:
    return "\n".join("  ".join(line).rstrip() for line in zip(*columns, strict=True))


@dataclass(frozen=True, slots=True)
class Line:
    """One curve: x, y, and half the length of the error bar at each point, or none."""

    label: str
    x: Sequence[float]
    y: Sequence[float]
    error: Sequence[float] | None = None


@dataclass(frozen=True, slots=True)
class Panel:
    """One set of axes."""

    title: str
    x_label: str
    y_label: str
    lines: Sequence[Line]
    log_x: bool = False
    log_y: bool = False


@dataclass(frozen=True, slots=True)
class Study:
    """The outcome of one experiment.

    Attributes
    ----------
    name : of the experiment; files are named after it.
    table : all figures.
    panels : the charts, side by side.
    remarks : sentences that the tables bear out.
    """

    name: str
    table: Table
    panels: tuple[Panel, ...]
    remarks: tuple[str, ...] = ()


def _cell(value: Cell) -> str:
    return f"{value:.6g}" if isinstance(value, float) else f'"{value}"' if "," in str(value) else str(value)


def _short(value: Cell) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)
