"""`retrue accept`, from correspondences to the certificate."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest
from pypdf import PdfReader

from retrue import write_points, write_rig
from tests.acceptance.simulated import RIG, ball, noisy, seen

from .conftest import Retrue, names

ARTEFACT = ("--artefact", "sphere:50mm+-0.002mm")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", RIG)
    random = np.random.default_rng(0)
    for number, x in enumerate((-40, 30), start=1):
        points, _ = seen([ball(x, 5, 620, 50)], 4)
        write_points(tmp_path / f"p{number}.csv", noisy(points, random))
    return tmp_path


def test_a_certificate_is_written(retrue: Retrue, folder: Path) -> None:
    captures = folder / "p1.csv", folder / "p2.csv"
    more = ("--serial", "camera=4012", "ball=K 7", "--number", "A-1", "--max-form", "9", "--max-size", "2")
    run = retrue("accept", folder / "rig.json", *captures, *ARTEFACT, *more, "--out", folder / "c.pdf", "--json")
    assert run.status == 0, run.err
    assert run.json["verdict"] == "passed"
    values = [value for position in run.json["positions"] for value in position["values"]]
    assert [value["symbol"] for value in values] == ["PF", "PS", "PF", "PS"]
    assert all(value["expanded_uncertainty"] > 0 for value in values)
    reader = PdfReader(folder / "c.pdf")
    text = "\n".join(page.extract_text() for page in reader.pages)
    for part in (
        "Certificate of acceptance test",
        "A-1",
        "4012",
        "K 7",
        "CONFORMS",
        "interim check",
        "VDI/VDE 2634 part 2",
    ):
        assert part in text
    assert f"Page 1 of {len(reader.pages)}" in text
    assert hashlib.sha256(captures[0].read_bytes()).hexdigest() in text.replace("\n", "")


def test_beyond_a_limit_the_status_is_one(retrue: Retrue, folder: Path) -> None:
    run = retrue("accept", folder / "rig.json", folder / "p1.csv", *ARTEFACT, "--max-form", "0.01")
    assert run.status == 1
    assert run.out.startswith("failed: 1 value beyond the limit")
    assert max(map(len, run.out.splitlines())) <= 80


def test_nothing_is_certified_where_nothing_was_measured(retrue: Retrue, folder: Path) -> None:
    wrong = ("--artefact", "sphere:12mm", "--out", folder / "c.pdf", "--json")
    run = retrue("accept", folder / "rig.json", folder / "p1.csv", *wrong)
    assert run.status == 1
    assert (run.json["verdict"], run.json["cause"], run.json["out"]) == ("refused", "ArtefactNotFound", None)
    assert "c.pdf" not in names(folder)
    json.dumps(run.json, allow_nan=False)


def test_mistakes_are_one_line(retrue: Retrue, folder: Path) -> None:
    rig, capture = folder / "rig.json", folder / "p1.csv"
    retrue("accept", rig, capture, "--artefact", "sphere:5").require_complaint("artefact", "sphere:DIAMETER")
    retrue("accept", rig, capture, *ARTEFACT, "--out", folder / "c.doc").require_complaint("c.doc", "ends in .pdf")
    retrue("accept", rig, capture, *ARTEFACT, "--serial", "7").require_complaint("--serial", "NAME=VALUE")
    retrue("accept", rig, *ARTEFACT).require_complaint("expected at least one CAPTURE")
