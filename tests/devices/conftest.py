"""Test after test begins with the same rig in the same scene."""

from tests.asked_once import lit_once

__all__ = ["lit_once"]
