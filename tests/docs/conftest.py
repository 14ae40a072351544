"""Pages judge the same pictures as others do, one after the other."""

from tests.asked_once import judged_once, lit_once

__all__ = ["judged_once", "lit_once"]
