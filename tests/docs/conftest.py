"""Pages judge the same pictures as others do, one after the other."""

from tests.judged_once import judged_once
from tests.lit_once import lit_once

__all__ = ["judged_once", "lit_once"]
