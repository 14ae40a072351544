"""For tests of what is built upon the judge: the same captures of the same rig are judged once.

They, the rig and the options alone decide what it says, which its own tests see to; batches, watches, fleets, commands
and pages ask it of the same few frames in test after test.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from functools import lru_cache

import pytest

from retrue import Correspondences, Rig
from retrue.recalibration.judge import Judgement, judge
from retrue.recalibration.options import RecalibrateOptions


@pytest.fixture(scope="module", autouse=True)
def judged_once() -> Iterator[None]:
    def judged(rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions) -> Judgement:
        return _judged(pickle.dumps((rig, list(captures), options)))

    with pytest.MonkeyPatch.context() as patch:
        for job in ("verify", "recalibrate"):
            patch.setattr(f"retrue.recalibration.{job}.judge", judged)
        yield


@lru_cache(maxsize=500)
def _judged(asked: bytes) -> Judgement:
    return judge(*pickle.loads(asked))
