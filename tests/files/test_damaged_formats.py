"""Other tools' files, damaged: rubbish raises nothing but RetrueError."""

from __future__ import annotations

import contextlib

import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from retrue.errors import RetrueError
from retrue.files.foreign_rigs import RIG_FORMATS
from retrue.files.rigs import read_device, read_rig, write_rig
from tests.files.awkward_rigs import SIZES, make_rig


# What is still a rig may have a lens that folds by now, and is told so.
@pytest.mark.filterwarnings("ignore::retrue.errors.RetrueWarning")
@example("slmaster", 1255, 1255, b"1")
@given(st.sampled_from(RIG_FORMATS), st.integers(0, 10_000), st.integers(0, 10_000), st.binary(max_size=12))
def test_damaged_files_raise_nothing_else(
    tmp_path_factory: pytest.TempPathFactory, to: str, start: int, length: int, patch: bytes
) -> None:
    path = tmp_path_factory.getbasetemp() / "damaged"
    write_rig(path, make_rig(), to)
    content = path.read_bytes()
    start %= len(content)
    path.write_bytes(content[:start] + patch + content[start + length % 40 :])
    for read in (lambda: read_rig(path, **SIZES, unit="mm"), lambda: read_device(path, "camera", size=(1280, 1024))):
        with contextlib.suppress(RetrueError):  # it may still be a rig
            read()


@given(st.text(alphabet="{}[]<>:'\"%!&*-.,# \n\tcam_KRTdatrows3e1lensmodel", max_size=300))
def test_rubbish_raises_nothing_else(tmp_path_factory: pytest.TempPathFactory, text: str) -> None:
    path = tmp_path_factory.getbasetemp() / "rubbish"
    path.write_text(text)
    with pytest.raises(RetrueError):
        read_rig(path, **SIZES, unit="mm")
