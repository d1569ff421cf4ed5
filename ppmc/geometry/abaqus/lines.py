"""Abaqus input files cut into keyword blocks; every line remembers where it stands.

Keywords and parameters are read as Abaqus reads them: in any case, with blanks anywhere ("* Node , NSET = a"),
continued on the next line after a comma, with comments (``**``) and empty lines between any two lines. ``*INCLUDE`` and
the parameter ``INPUT`` put the lines of other files in their place.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

from ppmc.errors import InputFileError

DEEPEST_INCLUDE = 20
LINE_END = re.compile(r"\r\n|\n|\r")
EXPONENT = re.compile(r"([+-]?(?:[0-9]+\.?[0-9]*|\.[0-9]+))([+-][0-9]+)")
WORDS = re.compile(r'(?:[^,"]|"[^"]*")+|(?<=,)(?=,)|(?<=,)$')


@dataclass(frozen=True)
class Row:
    """A data line.

    Attributes
    ----------
    text : str
        As it stands.
    where : tuple of (Path, int)
        File and line.
    """

    text: str
    where: tuple[Path, int]

    @property
    def fields(self) -> list[str]:
        """The values between commas, without blanks around them; one more if the line ends with a comma."""
        return [word.strip() for word in self.text.split(",")]

    @property
    def place(self) -> str:
        """``file:line``."""
        return f"{self.where[0]}:{self.where[1]}"


@dataclass(eq=False)
class Block:
    """A keyword with its parameters and data lines.

    Attributes
    ----------
    keyword : str
        In capitals, single blanks: ``SOLID SECTION``.
    options : dict of str
        Parameters in capitals; values as they stand, quotes removed; empty for those without a value.
    where : tuple of (Path, int)
        File and line.
    rows : list of Row
    """

    keyword: str
    options: dict[str, str]
    where: tuple[Path, int]
    rows: list[Row] = field(default_factory=list)

    @property
    def place(self) -> str:
        """``file:line: *KEYWORD``, as messages begin."""
        return f"{self.where[0]}:{self.where[1]}: *{self.keyword}"

    def name(self, option: str) -> str | None:
        """Return the value of a parameter as labels compare: in capitals."""
        value = self.options.get(option)
        return value.upper() if value is not None else None

    def required(self, option: str) -> str:
        """Return the value of a parameter that must be there, in capitals.

        Raises
        ------
        InputFileError
            If it is missing.
        """
        value = self.name(option)
        if not value:
            raise InputFileError(f"{self.place} lacks the parameter {option}=")
        return value


def blocks(path: Path, files: list[Path] | None = None) -> Iterator[Block]:
    """Yield the blocks of an input file and of those it includes.

    Parameters
    ----------
    path : Path
    files : list of Path, optional
        Receives every file that is read, `path` first.

    Raises
    ------
    InputFileError
        If a file is missing, includes itself, or data stand before the first keyword.
    """
    path = Path(path)
    read = files if files is not None else []
    block: Block | None = None
    for row in _rows(path, path.parent, (), read):
        if not row.text.startswith("*"):
            if block is None:
                raise InputFileError(
                    f"{row.place}: '{row.text[:40]}' stands before any keyword; an Abaqus input file begins with one"
                )
            block.rows.append(row)
            continue
        if block is not None:
            yield block
        block = _keyword(row)
        external = block.options.get("INPUT")
        if external:
            block.rows += list(_rows(_found(external, path.parent, row), path.parent, (path,), read))
    if block is not None:
        yield block


def _rows(path: Path, folder: Path, above: tuple[Path, ...], files: list[Path]) -> Iterator[Row]:
    """Yield the lines that count, keyword lines joined with those that continue them, includes followed."""
    if path in above or len(above) > DEEPEST_INCLUDE:
        raise InputFileError(f"{path}: is included by itself, over {' and '.join(str(p) for p in above)}")
    files.append(path)
    try:
        # Latin-1 reads any byte; names in other encodings keep their bytes, and keywords and numbers are ASCII.
        text = path.read_text(encoding="latin-1").removeprefix("\xef\xbb\xbf")
    except OSError as error:
        raise InputFileError(f"{path}: cannot be read: {error.strerror or error}") from None
    if "\0" in text:
        raise InputFileError(f"{path}: is no text; an Abaqus input file is needed, not a database")
    head: Row | None = None
    for number, raw in enumerate(LINE_END.split(text), 1):
        line = raw.strip()
        if not line or line.startswith("**"):
            continue
        row = Row(line, (path, number))
        if head is not None and not line.startswith("*"):
            head = Row(f"{head.text} {line}", head.where)
        elif head is not None:
            yield from _followed(head, folder, (*above, path), files)
            head = row
        elif line.startswith("*"):
            head = row
        else:
            yield row
            continue
        if head.text.endswith(","):
            continue
        yield from _followed(head, folder, (*above, path), files)
        head = None
    if head is not None:
        yield from _followed(head, folder, (*above, path), files)


def _followed(row: Row, folder: Path, above: tuple[Path, ...], files: list[Path]) -> Iterator[Row]:
    """Yield a keyword line, or the lines of the file that it includes."""
    block = _keyword(row)
    if block.keyword != "INCLUDE":
        yield row
        return
    if "PASSWORD" in block.options:
        raise InputFileError(f"{block.place}: encrypted files cannot be read; include the plain text")
    if not block.options.get("INPUT"):
        raise InputFileError(f"{block.place} lacks the parameter INPUT=")
    yield from _rows(_found(block.options["INPUT"], folder, row), folder, above, files)


def _found(name: str, folder: Path, row: Row) -> Path:
    """Return a file that is named in an input file: beside the job's own, or beside the file that names it."""
    tried = [Path(name), folder / name, row.where[0].parent / name]
    for path in tried[1:] if not tried[0].is_absolute() else tried[:1]:
        if path.is_file():
            return path
    raise InputFileError(f"{row.place}: '{name}' is not found in {folder}; put the file there")


def _keyword(row: Row) -> Block:
    """Return the block that a keyword line begins."""
    words = [word.strip() for word in WORDS.findall(row.text[1:])]
    options = {}
    for word in words[1:]:
        key, _, value = word.partition("=")
        if key.strip():
            options[" ".join(key.split()).upper()] = value.strip().strip('"')
    return Block(" ".join(words[0].split()).upper() if words else "", options, row.where)


def real(word: str, row: Row) -> float:
    """Return a number as Fortran writes it: 1.5E3, 1.5D+03 or 1.5+3; nothing is zero.

    Raises
    ------
    InputFileError
        If it is none.
    """
    if not word:
        return 0.0
    try:
        return float(word)
    except ValueError:
        pass
    found = EXPONENT.fullmatch(word)
    try:
        return float(f"{found[1]}e{found[2]}" if found else word.upper().replace("D", "E"))
    except ValueError:
        hint = " (a *PARAMETER is not worked out)" if word.startswith("<") else ""
        raise InputFileError(f"{row.place}: '{word}' is no number{hint}") from None


def label(word: str, row: Row) -> int:
    """Return a node's or element's number.

    Raises
    ------
    InputFileError
        If it is none.
    """
    try:
        number = int(word)
    except ValueError:
        # Some programs write labels as 12.0.
        value = real(word, row) if word else float("nan")
        if value != value or value != int(value):
            raise InputFileError(f"{row.place}: '{word}' is no number of a node or element") from None
        number = int(value)
    if number < 1:
        raise InputFileError(f"{row.place}: {number} is no number of a node or element; they count from 1")
    return number
