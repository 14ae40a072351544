"""The judge is asked the same of test after test."""

from tests.judged_once import judged_once

__all__ = ["judged_once"]
