"""Results write the pages about themselves."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import retrue
from tests.examples import examples
from tests.recalibration.scenes import RIG

PICTURE = np.full((960, 1280, 3), 90, np.uint8)
SIZES = {"camera": (1280, 960), "projector": (1024, 768)}


def given(name: str) -> dict[str, Any]:
    job = {"rig": RIG, "captures": [examples()["Correspondences"]], "pictures": [PICTURE]}
    return {"Calibrated": {}, "RefusedCalibration": {"sizes": SIZES}}.get(name, job)


@pytest.mark.parametrize("name", ["Accepted", "Refused", "Verification", "Cloud", "Calibrated", "RefusedCalibration"])
def test_a_result_writes_its_page(name: str, tmp_path: Path) -> None:
    result: Any = examples()[name]
    result.report(tmp_path / "method.html", **given(name))
    retrue.write_report(tmp_path / "function.html", result, **given(name))
    texts = [(tmp_path / f"{page}.html").read_text(encoding="utf-8") for page in ("method", "function")]
    assert texts[0].startswith("<!doctype html>")
    assert "retrue.write_report" in texts[0]
    assert len(texts[0]) == len(texts[1])
    if name in ("Accepted", "Refused", "Verification", "Cloud"):
        assert "data:image/" in texts[0]  # the photograph


@pytest.mark.parametrize(
    ("name", "changed", "said"),
    [
        ("Accepted", {"rig": None}, r"rig: expected what the job was given, found None; report\(path, rig=rig, "),
        ("Accepted", {"captures": ()}, "captures: expected at least one, found none"),
        ("Refused", {"pictures": [PICTURE, PICTURE]}, "pictures: expected at most one of each capture, 1, found 2"),
        ("Cloud", {"captures": 2}, "captures: expected the one that the cloud was made of, found 2"),
        ("RefusedCalibration", {"sizes": None}, "sizes: expected those of both pictures"),
    ],
)
def test_what_a_page_lacks_is_asked_for(name: str, changed: dict[str, Any], said: str, tmp_path: Path) -> None:
    result: Any = examples()[name]
    changed = {key: [examples()["Correspondences"]] * 2 if value == 2 else value for key, value in changed.items()}
    with pytest.raises(retrue.InputError, match=f"^{said}"):
        result.report(tmp_path / "page.html", **{**given(name), **changed})
    assert list(tmp_path.iterdir()) == []


def test_only_results_have_pages(tmp_path: Path) -> None:
    with pytest.raises(retrue.InputError, match=r"^result: expected .* found a Rig$"):
        retrue.write_report(tmp_path / "page.html", RIG)  # type: ignore[arg-type]
    with pytest.raises(retrue.InputError, match=r"^path: expected text or a pathlib.Path, as in write_report"):
        retrue.write_report(examples()["Accepted"], "page.html")  # type: ignore[arg-type]
