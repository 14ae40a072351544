"""The judge is asked the same of a rig by one job after the other."""

from tests.judged_once import judged_once

__all__ = ["judged_once"]
