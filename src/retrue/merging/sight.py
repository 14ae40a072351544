"""What two views say against each other at a pose: where one's camera saw through, or nothing, the other's surface.

Surfaces that happen to lie on each other, such as a box's sides after a quarter of a turn, are no proof of a pose. Of
each point that the other camera ought to have seen, three things can be: a surface was seen there, it was seen through
there, or nothing was seen.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from retrue.geometry.arrays import BoolArray, FloatArray
from retrue.geometry.transform import RigidTransform
from retrue.merging.view import View

BAND = 0.5  # cells before the other surface, and more than noise, that contradict; as much behind it are hidden
FACING = 0.3  # cosine to the camera's ray from which on a decoder sees a surface
TIED = (4.0, 0.05, 0.95)  # Dirichlet's alpha of seen, seen through and missed: shadows, gloss and grazing light leave
# much of some views unseen
ASTRAY = (3.0, 1.0, 6.0)  # and at wrong poses where surfaces were made to fit
TWIN = (16.0, 2.0, 2.0)  # and where the object is nearly its own copy, as a cube with a knob after a quarter of a turn
TWINS = 0.1  # of wrong poses
ALIKE = 5  # cells over which neighbours fare alike


@dataclass(frozen=True, slots=True)
class Sight:
    """How many points of one view the other camera saw, saw through, and missed; of how many in all."""

    seen: int
    before: int
    missed: int
    points: int

    @property
    def contradicted(self) -> float:
        """Share of all points that lie before what the other camera saw."""
        return self.before / self.points

    @property
    def overlooked(self) -> float:
        """Share of what the other camera ought to have seen where it saw nothing; zero of nothing."""
        return self.missed / max(self.seen + self.before + self.missed, 1)


def evidence(sights: Iterable[Sight]) -> float:
    """Log odds of right poses against wrong ones, by what one camera says of the points of one view or of several.

    How much a view misses is its own, and not known: counts are Dirichlet-multinomial, of places as large as neighbours
    fare alike.
    """
    counts = np.sum([[each.seen, each.before, each.missed] for each in sights], axis=0) / ALIKE**2
    tied, astray, twin = (_log_likelihood(counts, alpha) for alpha in (TIED, ASTRAY, TWIN))
    return float(tied - np.logaddexp(np.log1p(-TWINS) + astray, np.log(TWINS) + twin))


def _log_likelihood(counts: FloatArray, prior: Sequence[float]) -> float:
    from scipy.special import gammaln

    alpha = np.array(prior)
    every = gammaln(alpha.sum()) - gammaln((alpha + counts).sum())
    return float(every + (gammaln(alpha + counts) - gammaln(alpha)).sum())


def sight(target: View, source: View, pose: RigidTransform, cell: float, off: float) -> Sight:
    """Of `source` as `target`'s camera has it, by `pose`, target_from_source; `off` is how far noise moves a point.

    A back of a surface that lies on the front of another says nothing: it may be the other side of a shell.
    """
    places, normals = pose.apply(source.points), source.normals @ pose.R.T
    ahead = places[:, 2] > 0
    rays = places[:, :2] / np.where(ahead, places[:, 2], 1.0)[:, None]
    depth = float(np.median(target.points[:, 2]))
    distance, row = target.ray_tree.query(np.where(ahead[:, None], rays, 1e9), distance_upper_bound=cell / depth)
    asked = np.isfinite(distance)
    row = np.where(asked, row, 0)
    height = ((places - target.points[row]) * target.normals[row]).sum(axis=1)
    cosine = -(places * normals).sum(axis=1) / np.linalg.norm(places, axis=1)
    band = BAND * cell + off
    seen = asked & (np.abs(height) <= band) & (cosine > 0)
    before = asked & (height > band)
    missed = ahead & ~asked & (cosine > FACING) & _in_field(target, rays)
    return Sight(int(seen.sum()), int(before.sum()), int(missed.sum()), len(places))


def _in_field(target: View, rays: FloatArray) -> BoolArray:
    return ((rays >= target.field[0]) & (rays <= target.field[1])).all(axis=1)
