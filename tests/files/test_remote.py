"""Captures in an object store; the one that fsspec keeps in memory stands for all."""

from __future__ import annotations

import pytest

pytest.importorskip("fsspec")

import fsspec

from retrue.errors import FileError, InputError
from retrue.files.remote import Remote, fetched, listed


@pytest.fixture
def store():
    store = fsspec.filesystem("memory")
    store.pipe({"/bucket/rig/1.csv": b"one", "/bucket/rig/2/a.png": b"a", "/bucket/rig/2/b.png": b"b"})
    yield store
    store.rm("/bucket", recursive=True)


def test_files_and_folders_are_found_and_fetched(store):
    file, folder = listed("memory://bucket/rig/*")
    assert (file.folder, folder.folder) == (False, True)
    with fetched(file) as path:
        assert (path.name, path.read_bytes()) == ("1.csv", b"one")
    assert not path.exists()
    with fetched(folder) as path:
        assert {item.name: item.read_bytes() for item in path.iterdir()} == {"a.png": b"a", "b.png": b"b"}
    assert not path.exists()


@pytest.mark.parametrize(("changed", "number"), [("/bucket/rig/1.csv", 0), ("/bucket/rig/2/b.png", 1)])
def test_a_stamp_changes_with_what_it_stands_for_and_with_nothing_else(store, changed, number):
    before = listed("memory://bucket/rig/*")
    assert listed("memory://bucket/rig/*") == before
    store.pipe(changed, b"other")
    after = listed("memory://bucket/rig/*")
    assert [one.stamp != two.stamp for one, two in zip(before, after, strict=True)] == [number == 0, number == 1]


@pytest.mark.parametrize("address", ["nowhere://bucket/*", "simplecache::memory://bucket/*"])
def test_an_address_of_no_use_is_named_in_one_line(address):
    with pytest.raises(InputError) as caught:
        listed(address)
    assert str(caught.value).startswith(address)
    assert "\n" not in str(caught.value)


def test_what_is_gone_is_named(store):
    gone = Remote("memory://bucket/gone.csv", "", None)
    with pytest.raises(FileError, match=r"memory://bucket/gone\.csv"), fetched(gone):
        raise AssertionError("nothing was fetched")
