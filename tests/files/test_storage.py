"""Outputs appear whole or not at all, and never over an input."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from ppmc.errors import SceneError, StorageError
from ppmc.files import check_output, whole_file


def test_input_is_never_the_output(tmp_path: Path) -> None:
    a = tmp_path / "a"
    a.touch()
    (tmp_path / "link").symlink_to(a)
    os.link(a, tmp_path / "hard")
    for same in (a, tmp_path / "." / "a", tmp_path / "link", tmp_path / "hard"):
        with pytest.raises(SceneError, match="input and output are the same file"):
            check_output(same, [None, a])
    assert check_output(tmp_path / "b", [a]) == tmp_path / "b"


def test_folder_is_made_and_must_be_writable(tmp_path: Path) -> None:
    check_output(tmp_path / "new" / "deep" / "x")
    assert (tmp_path / "new" / "deep").is_dir() and not list((tmp_path / "new" / "deep").iterdir())
    (tmp_path / "file").touch()
    with pytest.raises(StorageError, match="cannot write here"):
        check_output(tmp_path / "file" / "x")
    with pytest.raises(StorageError, match="is a folder"):
        check_output(tmp_path)


def test_read_only_folder(tmp_path: Path) -> None:
    folder = tmp_path / "ro"
    folder.mkdir()
    folder.chmod(0o500)
    if os.geteuid() == 0:
        # Permissions do not bind root; an immutable virtual folder does.
        folder = Path("/proc/self")
    with pytest.raises(StorageError, match="cannot write here"):
        check_output(folder / "x")


def test_full_disk_is_told_before_the_work(tmp_path: Path) -> None:
    with pytest.raises(StorageError, match="MiB needed"):
        check_output(tmp_path / "x", need_bytes=2**60)


def test_failure_leaves_nothing_and_keeps_the_old(tmp_path: Path) -> None:
    path = tmp_path / "x"
    path.write_text("old")
    with pytest.raises(KeyboardInterrupt), whole_file(path) as temporary:
        temporary.write_text("half")
        raise KeyboardInterrupt
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["x"]
    with pytest.raises(StorageError, match="nothing was left behind"), whole_file(path) as temporary:
        temporary.write_text("half")
        raise OSError(28, "No space left on device")
    assert path.read_text() == "old" and [p.name for p in tmp_path.iterdir()] == ["x"]
    with whole_file(path) as temporary:
        temporary.write_text("new")
    assert path.read_text() == "new" and [p.name for p in tmp_path.iterdir()] == ["x"]
