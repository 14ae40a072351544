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

    def text(self) -> str:
        """For people: aligned columns, three significant digits."""
        lines = [self.columns, *(tuple(_short(cell) for cell in row) for row in self.rows)]
        widths = [max(len(line[k]) for line in lines) for k in range(len(self.columns))]
        numeric = [all(not isinstance(row[k], str) for row in self.rows) for k in range(len(self.columns))]
        return "\n".join(
            [
                self.name,
                *(
                    "  ".join(
                        cell.rjust(w) if n else cell.ljust(w) for cell, w, n in zip(line, widths, numeric, strict=True)
                    ).rstrip()
                    for line in lines
                ),
            ]
        )


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
