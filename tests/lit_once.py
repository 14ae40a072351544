"""For tests with simulated rigs: where the light of the same rig goes, in the same scene, is followed once."""

from __future__ import annotations

from collections.abc import Iterator
from functools import lru_cache

import pytest

from retrue.rig import Rig
from retrue.simulation.light_transport import LightTransport, find_transport
from retrue.simulation.scene import Scene
from tests.judged_once import Asked


@pytest.fixture(scope="module", autouse=True)
def lit_once() -> Iterator[None]:
    def followed(rig: Rig, scene: Scene) -> LightTransport:
        return _followed(Asked.of(rig, scene))

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("retrue.devices.simulated_light.find_transport", followed)
        yield


@lru_cache(maxsize=8)
def _followed(asked: Asked) -> LightTransport:
    return find_transport(*asked.question)
