"""The judge is asked the same of a rig by one job after the other."""

from tests.asked_once import judged_once

__all__ = ["judged_once"]
