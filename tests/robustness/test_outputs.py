"""What an output may replace, who may write it, and when it counts as unchanged."""

from __future__ import annotations

import os
import signal
import socket
import time
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import h5py
import numpy as np
import pytest

from ppmc.chain import is_current, links, run_chain
from ppmc.cli import _run
from ppmc.errors import StorageError
from ppmc.files.lock import Claim, confirm_locks, locked
from ppmc.scene import load_scene

SCENE = """\
name: small
charge:
  domain: {shape: mesh, file: domain.stl}
  spacing: 0.5 mm
  orientation: {source: file, file: points.csv}
"""
CORNERS = np.array([[x, y, z] for z in (0, 1) for y in (0, 1) for x in (0, 1)], float)
FACES = (0, 2, 3), (0, 3, 1), (4, 5, 7), (4, 7, 6), (0, 1, 5), (0, 5, 4), (2, 6, 7), (2, 7, 3), (0, 4, 6), (0, 6, 2)
FACES = (*FACES, (1, 3, 7), (1, 7, 5))


def write_cube(path: Path, size: float) -> None:
    lines = ["solid cube"]
    for face in FACES:
        corners = "".join("vertex {:g} {:g} {:g}\n".format(*(size * CORNERS[k])) for k in face)
        lines.append(f"facet normal 0 0 0\nouter loop\n{corners}endloop\nendfacet")
    path.write_text("\n".join([*lines, "endsolid cube", ""]))


def write_points(path: Path, p: str) -> None:
    rows = [f"{x},{y},1,{p},0,0,1" for x in range(3) for y in range(3)]
    path.write_text("\n".join(["x1,x2,x3,p1,p2,p3,r1,r2,r3", *rows, ""]))


@pytest.fixture
def case(tmp_path: Path) -> Path:
    (tmp_path / "scene.yaml").write_text(SCENE)
    write_cube(tmp_path / "domain.stl", 2.0)
    write_points(tmp_path / "points.csv", "1,0,0")
    return tmp_path


def charge(case: Path, output: Path | str, *options: str) -> int:
    return _run(["charge", str(case / "scene.yaml"), "--output", str(case / output), *options])


@pytest.mark.parametrize(
    ("name", "code", "told"),
    [
        ("scene.yaml", 2, "input and output are the same file"),
        ("domain.stl", 2, "input and output are the same file"),
        ("thesis.txt", 2, "is not a file of ppmc"),
        ("other.h5", 2, "is not a file of ppmc"),
        ("folder", 5, "is a folder"),
        ("pipe", 5, "is a FIFO"),
        ("link_to_device", 5, "is a device"),
        ("link_to_thesis", 2, "is not a file of ppmc"),
    ],
)
def test_only_its_own_kind_is_replaced(
    case: Path, name: str, code: int, told: str, capsys: pytest.CaptureFixture[str]
) -> None:
    (case / "thesis.txt").write_text("years of work")
    with h5py.File(case / "other.h5", "w") as file:
        file["x"] = 1.0
    (case / "folder").mkdir()
    os.mkfifo(case / "pipe")
    (case / "link_to_device").symlink_to("/dev/null")
    (case / "link_to_thesis").symlink_to("thesis.txt")
    before = {p.name: p.read_bytes() for p in case.iterdir() if p.is_file()}
    assert charge(case, name) == code
    assert told in capsys.readouterr().err
    assert {p.name: p.read_bytes() for p in case.iterdir() if p.is_file()} == before
    assert (case / "pipe").is_fifo() and (case / "link_to_device").is_symlink()


def test_force_replaces_files_but_no_input(case: Path) -> None:
    (case / "thesis.txt").write_text("years of work")
    assert charge(case, "thesis.txt", "--force") == 0
    assert charge(case, "thesis.txt") == 0  # it is a charge now
    assert charge(case, "scene.yaml", "--force") == 2
    assert (case / "scene.yaml").read_text() == SCENE


def test_a_link_keeps_leading_to_its_target(case: Path) -> None:
    (case / "store").mkdir()
    (case / "c.vtkhdf").symlink_to("store/real.vtkhdf")
    assert charge(case, "c.vtkhdf") == 0
    assert (case / "c.vtkhdf").is_symlink() and (case / "store" / "real.vtkhdf").is_file()


def holding(path: Path) -> int:
    """Return the process number of a child that holds an output's lock until it is killed."""
    reading, writing = os.pipe()
    child = os.fork()
    if child == 0:
        with locked([Claim(path)]):
            os.write(writing, b"x")
            time.sleep(600)
        os._exit(0)
    os.close(writing)
    assert os.read(reading, 1) == b"x"
    os.close(reading)
    return child


def test_the_second_writer_is_refused_and_told_of_the_first(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (case / "link.vtkhdf").symlink_to("c.vtkhdf")
    child = holding(case / "c.vtkhdf")
    try:
        for name in ("c.vtkhdf", "link.vtkhdf"):
            assert charge(case, name) == 5
            told = capsys.readouterr().err
            assert f"process {child} on {socket.gethostname()}, since 2" in told and "is writing it" in told
        assert not (case / "c.vtkhdf").exists()
        assert charge(case, "other.vtkhdf") == 0
    finally:
        os.kill(child, signal.SIGKILL)
        os.waitpid(child, 0)
    assert (case / ".c.lock").exists()  # what a killed process leaves holds up nobody
    assert charge(case, "c.vtkhdf") == 0
    assert not list(case.glob(".*"))


def test_of_two_at_once_one_wins(tmp_path: Path) -> None:
    """Both try at once; whoever wins holds on until both have tried."""
    for pair in range(20):
        told, tell = os.pipe()
        wait, go = os.pipe()
        children = []
        for _ in range(2):
            child = os.fork()
            if child == 0:
                os.close(go)
                try:
                    with locked([Claim(tmp_path / f"{pair}.vtkhdf")]):
                        os.write(tell, b"0")
                        os.read(wait, 1)
                        confirm_locks()
                    os._exit(0)
                except StorageError:
                    os.write(tell, b"5")
                    os._exit(5)
            children.append(child)
        assert sorted(os.read(told, 1) + os.read(told, 1)) == sorted(b"05"), pair
        os.close(go)
        codes = sorted(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]) for child in children)
        assert codes == [0, 5], pair
        for end in (told, tell, wait):
            os.close(end)


def test_who_holds_a_lock_may_ask_again_but_no_other_thread(tmp_path: Path) -> None:
    """A command takes the lock before it loads the stage, which takes it too; it ends with the outer block."""
    path = tmp_path / "c.vtkhdf"

    def tried() -> str:
        try:
            with locked([Claim(path)]):
                return "taken"
        except StorageError as error:
            return str(error)

    with locked([Claim(path)]):
        assert tried() == "taken"
        assert (tmp_path / ".c.lock").exists()
        with ThreadPoolExecutor(1) as other:
            assert "this very process" in other.submit(tried).result()
    assert not list(tmp_path.iterdir())
    with locked([Claim(path, shared=True)]):
        assert "this very process" in tried()  # a share is not the whole


def test_what_killed_writers_left_goes_with_the_next(tmp_path: Path) -> None:
    left = [".c.vtkhdf.7.tmp", ".c.checkpoint-a.h5ckpt.7.tmp", ".c.steps.csv.7.tmp"]
    kept = [".c.d.vtkhdf.7.tmp", "c.vtkhdf", ".other.tmp"]
    for name in (*left, *kept):
        (tmp_path / name).write_text("")
    (tmp_path / ".c.partial.7.tmp").mkdir()
    (tmp_path / ".c.partial.7.tmp" / "frame_000000.vtkhdf").write_text("")
    with locked([Claim(tmp_path / "c.vtkhdf")]):
        pass
    assert sorted(p.name for p in tmp_path.iterdir()) == sorted(kept)


def test_shares_of_one_volume_work_beside_each_other(tmp_path: Path) -> None:
    from ppmc.ct.stage import _claims

    output = tmp_path / "o.vtkhdf"
    first, second, whole = (_claims({"output": output, "part": part}) for part in ((1, 2), (2, 2), None))

    def tried(claims: list[Claim]) -> int:
        child = os.fork()
        if child == 0:
            try:
                with locked(claims):
                    os._exit(0)
            except StorageError:
                os._exit(5)
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])

    with locked(first):
        assert (tried(second), tried(first), tried(whole)) == (0, 5, 5)
    assert tried(whole) == 0


def test_a_lock_that_was_lost_is_noticed(tmp_path: Path) -> None:
    with locked([Claim(tmp_path / "c.vtkhdf")]):
        (tmp_path / ".c.lock").unlink()
        confirm_locks()  # nobody else has it: taken again
        (tmp_path / ".c.lock").unlink()
        child = holding(tmp_path / "c.vtkhdf")
        try:
            with pytest.raises(StorageError, match=f"process {child}"):
                confirm_locks()
        finally:
            os.kill(child, signal.SIGKILL)
            os.waitpid(child, 0)


def damage(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


@pytest.mark.parametrize(
    ("what", "edit"),
    [
        ("domain.stl", lambda path: write_cube(path, 3.0)),
        ("points.csv", lambda path: write_points(path, "0,1,0")),
        ("run/charge.vtkhdf", damage),
        ("run/charge.vtkhdf", lambda path: path.unlink()),
    ],
)
def test_an_edit_of_anything_named_is_noticed(
    case: Path, what: str, edit: Callable[[Path], None], capsys: pytest.CaptureFixture[str]
) -> None:
    scene = load_scene(case / "scene.yaml")
    run_chain(scene, workdir=case / "run")
    first = (case / "run" / "charge.vtkhdf").read_bytes()
    capsys.readouterr()
    run_chain(scene, workdir=case / "run")
    assert "unchanged" in capsys.readouterr().err
    edit(case / what)
    run_chain(scene, workdir=case / "run")
    assert "writing" in capsys.readouterr().err
    assert ((case / "run" / "charge.vtkhdf").read_bytes() == first) == what.startswith("run")
    run_chain(scene, workdir=case / "run")
    assert "unchanged" in capsys.readouterr().err


def test_an_export_replaces_nothing_that_the_scene_names(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Not even a file that an earlier export has written."""
    assert charge(case, "first.vtkhdf", "--export", str(case / "other.csv")) == 0
    (case / "other.csv").replace(case / "points.csv")
    before = (case / "points.csv").read_bytes()
    assert charge(case, "c.vtkhdf", "--export", str(case / "points.csv"), "--force") == 2
    assert "input and output are the same file" in capsys.readouterr().err
    assert (case / "points.csv").read_bytes() == before


def test_an_analysis_replaces_nothing_of_others(case: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Refused before anything is written; what it wrote itself, and what a killed one has left, is replaced."""
    output = case / "a" / "analysis.vtkhdf"
    text = SCENE + "analysis: {path: {kind: straight, axis: x1, slices: 2}, views: []}\n"
    (case / "scene.yaml").write_text(text)
    assert charge(case, "c.vtkhdf") == 0
    command = ["analyze", str(case / "scene.yaml"), "--input", str(case / "c.vtkhdf"), "--output", str(output)]
    for name in ("tables/regions.csv", "figures/path_path.png", "report.html"):
        (case / "a" / name).parent.mkdir(parents=True, exist_ok=True)
        (case / "a" / name).write_text("years of work\n")
        before = {p: p.read_bytes() for p in (case / "a").rglob("*") if p.is_file()}
        assert _run(command) == 2
        assert f"{name}: was not written by ppmc and would be replaced" in capsys.readouterr().err
        assert {p: p.read_bytes() for p in (case / "a").rglob("*") if p.is_file()} == before
        (case / "a" / name).unlink()
    assert _run(command) == 0
    (case / "a" / "figures" / ".path_path.png.7.tmp").write_text("half a picture")
    output.unlink()
    assert _run(command) == 0
    assert not list((case / "a").rglob(".*"))


def test_an_edit_runs_what_depends_on_it_and_no_more(case: Path) -> None:
    """A mould that is no drape of the charge makes no other charge."""
    text = SCENE + "tooling: {lower: {shape: mesh, file: tool.stl}}\n"
    (case / "scene.yaml").write_text(text)
    write_cube(case / "tool.stl", 4.0)
    scene = load_scene(case / "scene.yaml")
    paths = run_chain(scene, workdir=case / "run")
    write_cube(case / "tool.stl", 5.0)
    (link,) = links(scene, paths)
    assert is_current(link, scene)
    assert case / "tool.stl" in scene.every_named_file()


def test_included_files_count(tmp_path: Path) -> None:
    """An input file that includes another, and an HDF5 file that keeps its data elsewhere."""
    from ppmc.files import file_digest

    (tmp_path / "a.inp").write_text("*NODE\n*INCLUDE, INPUT=b.inp\n")
    (tmp_path / "b.inp").write_text("*include, input = 'c.inp'\n")
    (tmp_path / "c.inp").write_text("1, 0, 0, 0\n")
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["x"] = np.arange(3.0)
    with h5py.File(tmp_path / "master.h5", "w") as file:
        file["entry"] = h5py.ExternalLink("data.h5", "x")
    for named, edited in (("a.inp", "c.inp"), ("master.h5", "data.h5")):
        before = file_digest(tmp_path / named)
        damage(tmp_path / edited)
        assert file_digest(tmp_path / named) != before
