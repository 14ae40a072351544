"""Files that are replaced keep who may read them; new ones are made as the umask says."""

from __future__ import annotations

import os
from concurrent.futures import ThreadPoolExecutor

import pytest

from retrue.errors import FileError
from retrue.files.atomic import replaced_file


@pytest.fixture
def umask():
    before = os.umask(0o027)
    yield
    os.umask(before)


@pytest.mark.parametrize("alone", [True, False])
def test_a_new_file_is_made_as_the_umask_says_and_an_old_one_keeps_its_mode(tmp_path, umask, alone):
    path = tmp_path / "state.json"
    for mode in (0o640, 0o600):
        with replaced_file(path, alone=alone) as stream:
            stream.write(b"new")
        assert path.stat().st_mode & 0o777 == mode
        path.chmod(0o600)
    assert [found.name for found in tmp_path.iterdir()] == ["state.json"]


def test_the_bytes_that_wait_are_no_more_readable_than_the_file(tmp_path):
    path = tmp_path / "secret"
    path.write_bytes(b"old")
    path.chmod(0o600)
    with replaced_file(path, alone=True):
        waiting = next(found for found in tmp_path.iterdir() if found != path)
        assert waiting.stat().st_mode & 0o777 == 0o600


def test_many_threads_leave_the_umask_of_the_process(tmp_path, umask):
    def write(number: int) -> None:
        with replaced_file(tmp_path / f"{number}") as stream:
            stream.write(b"new")

    with ThreadPoolExecutor(16) as pool:
        list(pool.map(write, range(200)))
    assert {found.stat().st_mode & 0o777 for found in tmp_path.iterdir()} == {0o640}


def test_a_folder_that_is_none_is_an_error_of_the_file(tmp_path):
    with pytest.raises(FileError, match="cannot be written"), replaced_file(tmp_path / "none" / "file"):
        pass
