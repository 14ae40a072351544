"""Sigmas from medians, which outliers do not move."""

from __future__ import annotations

MAD_TO_SIGMA = 1.4826
"""Sigma of a normal distribution, in medians of the absolute deviation."""
MEDIAN_DISTANCE = 1.1774
"""Median length of two independent normal components, in their sigma."""
