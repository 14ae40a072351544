"""For tests of what is built upon the judge, or upon simulated rigs: the same question is answered once.

What is asked alone decides the answer, which the tests of its own see to; batches, watches, fleets, commands and pages
ask the same of few frames in test after test.
"""

from __future__ import annotations

import pickle
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import lru_cache
from hashlib import sha256
from typing import Any

import pytest

from retrue.recalibration.judge import judge
from retrue.simulation.light_transport import find_transport


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


def _asked_once(name: str, answer: Callable[..., Any], most: int) -> Any:
    """A fixture that has `answer`, under that name, remember as many of its answers."""

    @lru_cache(maxsize=most)
    def remembered(asked: Asked) -> Any:
        return answer(*asked.question)

    def asked(*question: Any) -> Any:
        return remembered(Asked.of(*question))

    @pytest.fixture(scope="module", autouse=True)
    def once() -> Iterator[None]:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(name, asked)
            yield

    return once


judged_once = _asked_once("retrue.recalibration.misread.judge", judge, 500)
lit_once = _asked_once("retrue.devices.simulated_light.find_transport", find_transport, 8)
