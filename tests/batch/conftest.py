"""The judge is asked the same of test after test."""

from tests.asked_once import judged_once

__all__ = ["judged_once"]
