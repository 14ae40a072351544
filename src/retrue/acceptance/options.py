"""What an acceptance test can be told; apart from it, so that `--help` need not load NumPy."""

from __future__ import annotations

from dataclasses import dataclass

from retrue.ranges import check_ranges, ranged


@dataclass(frozen=True, slots=True)
class AcceptOptions:
    """Limits of an acceptance test; lengths in the rig's unit.

    Attributes
    ----------
    max_form
        Largest probing error of form that is accepted; without it, it is only measured.
    max_size
        The same of size, either way.
    max_spacing
        The same of the spacing of two balls, either way.
    max_flatness
        The same of a plane's flatness.
    diagonal
        Body diagonal of the measuring volume, by which the guideline sizes artefacts.
    fewest_points
        Refuse a position with fewer points on the artefact, or on each of its balls.
    cap_deg
        Points of a ball count up to this angle between their normal and the line to the camera.
    outliers_permille
        Share of the points that form and flatness leave out.
    """

    max_form: float | None = ranged(None, 0, above=True)
    max_size: float | None = ranged(None, 0, above=True)
    max_spacing: float | None = ranged(None, 0, above=True)
    max_flatness: float | None = ranged(None, 0, above=True)
    diagonal: float | None = ranged(None, 0, above=True)
    fewest_points: int = ranged(100, 30)
    cap_deg: float = ranged(60.0, 20, 85)
    outliers_permille: float = ranged(3.0, 0, 50)

    def __post_init__(self) -> None:
        check_ranges(self)
