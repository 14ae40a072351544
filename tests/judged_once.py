"""For tests of what is built upon the judge: the same captures of the same rig are judged once.

They, the rig and the options alone decide what it says, which its own tests see to; batches, watches, fleets, commands
and pages ask it of the same few frames in test after test.
"""

from __future__ import annotations

import pickle
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import sha256
from typing import Any

import pytest

from retrue import Correspondences, Rig
from retrue.recalibration.judge import Judgement, judge
from retrue.recalibration.options import RecalibrateOptions


@dataclass(frozen=True)
class Asked:
    """What somebody was asked; equal where the bytes of all are."""

    digest: bytes
    question: tuple[Any, ...] = field(compare=False)

    @classmethod
    def of(cls, *question: Any) -> Asked:
        """With the bytes of its arrays."""
        digest = sha256()
        digest.update(pickle.dumps(question, 5, buffer_callback=lambda array: digest.update(array.raw())))
        return cls(digest.digest(), question)


@pytest.fixture(scope="module", autouse=True)
def judged_once() -> Iterator[None]:
    def judged(rig: Rig, captures: Sequence[Correspondences], options: RecalibrateOptions) -> Judgement:
        return _judged(Asked.of(rig, list(captures), options))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("retrue.recalibration.misread.judge", judged)
        yield


@lru_cache(maxsize=500)
def _judged(asked: Asked) -> Judgement:
    return judge(*asked.question)
