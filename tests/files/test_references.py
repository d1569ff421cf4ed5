"""Files behind files: whatever a named file refers to counts, too."""

from pathlib import Path

import h5py
import pytest

from ppmc.files.references import referenced_files


def test_decks_name_files_on_any_keyword_and_continued_lines(tmp_path: Path) -> None:
    (tmp_path / "sub").mkdir()
    for name in ("nodes.inp", "sub/sets.inp", "field.csv", "deep.inp"):
        (tmp_path / name).write_text("1, 0, 0, 0\n")
    (tmp_path / "sub" / "sets.inp").write_text("*INCLUDE, INPUT=deep.inp\n")
    deck = tmp_path / "deck.inp"
    deck.write_text(
        "*Node , input = nodes.inp\n*include,\n INPUT='sub/sets.inp'\n*DISTRIBUTION, NAME=d, LOCATION=ELEMENT,\n"
        "INPUT=field.csv\n*ELSET, INPUT=missing.inp\n"
    )
    # The included file names another one as seen from the deck that was opened.
    assert {path.name for path in referenced_files(deck)} == {"nodes.inp", "sets.inp", "field.csv", "deep.inp"}


@pytest.mark.parametrize(
    ("header", "text"),
    [("a.mhd", "NDims = 3\nElementDataFile = a.raw\n"), ("a.nhdr", "NRRD0004\ndata file: a.raw\n"), ("a.hdr", "")],
)
def test_headers_name_their_data(tmp_path: Path, header: str, text: str) -> None:
    (tmp_path / header).write_text(text)
    data = tmp_path / ("a.img" if header.endswith("hdr") and not header.endswith("nhdr") else "a.raw")
    data.write_bytes(b"x")
    assert referenced_files(tmp_path / header) == (data.resolve(),)


def test_links_of_other_programs_are_followed(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "data.h5", "w") as file:
        file["x"] = [1.0, 2.0]
    with h5py.File(tmp_path / "master.nxs", "w") as file:
        file["entry"] = h5py.ExternalLink("data.h5", "/x")
    assert referenced_files(tmp_path / "master.nxs") == ((tmp_path / "data.h5").resolve(),)


def test_files_that_name_each_other_end(tmp_path: Path) -> None:
    (tmp_path / "a.inp").write_text("*INCLUDE, INPUT=b.inp\n")
    (tmp_path / "b.inp").write_text("*INCLUDE, INPUT=a.inp\n")
    assert [path.name for path in referenced_files(tmp_path / "a.inp")] == ["b.inp"]
