"""Journals: what is in them is read again after whatever ended the writing."""

import os

import pytest

from ccpin.errors import InvalidInputError
from ccpin.files import Journal

HEADER = {"format": "test-1", "task": "count"}


def written(path, count):
    with Journal(path, HEADER) as journal:
        for k in range(count):
            journal.append({"number": k, "text": "ä" * k})
    return journal


def test_records_come_back(tmp_path):
    """One by one and from the end, before and after it is closed, and when it is opened again."""
    path = tmp_path / "folder" / "numbers"
    with Journal(path, HEADER) as journal:
        journal.append({"number": 0})
        assert (len(journal), journal[0]) == (1, {"number": 0})
    again = written(path, 3)
    assert [record["number"] for record in again] == [0, 0, 1, 2]
    assert again[-1] == {"number": 2, "text": "ää"}
    assert [record["number"] for record in again[1:3]] == [0, 1]
    with pytest.raises(IndexError):
        again[4]


@pytest.mark.parametrize("end", [b'{"number": 3', b"\0\0\0\n", b'{"number": 3}\0\n', b"[1]\n", b"\xff"])
def test_a_broken_end_is_cut_off(tmp_path, end):
    """A last line without its end, or one that is no record; what comes next is in its place."""
    path = tmp_path / "numbers"
    written(path, 3)
    whole = path.read_bytes()
    path.write_bytes(whole + end)
    journal = written(path, 1)
    assert [record["number"] for record in journal] == [0, 1, 2, 0]
    assert path.read_bytes().startswith(whole)


@pytest.mark.parametrize("size", [0, 1, 20])
def test_a_broken_beginning_is_begun_again(tmp_path, size):
    """A file that was cut off within its first line is one of the same task."""
    path = tmp_path / "numbers"
    written(path, 0)
    path.write_bytes(path.read_bytes()[:size])
    assert len(written(path, 2)) == 2


@pytest.mark.parametrize("text", ["my notes", "my notes\n", "[1, 2]\n", "\n", '{"format": "test-1", "task"'])
def test_other_files_are_left_alone(tmp_path, text):
    """What is no journal, or one of another task, is refused, and not a byte of it is changed."""
    path = tmp_path / "numbers"
    path.write_text(text)
    with pytest.raises(InvalidInputError, match="no journal"):
        Journal(path, HEADER | {"format": "test-2"})
    assert path.read_text() == text
    path.unlink()
    written(path, 1)
    before = path.read_bytes()
    with pytest.raises(InvalidInputError, match="another task: task is count there and sort here"):
        Journal(path, HEADER | {"task": "sort"})
    assert path.read_bytes() == before


def test_two_do_not_write_one_journal(tmp_path):
    """The second is refused while the first is open; after that both read what is there."""
    pytest.importorskip("fcntl")
    path = tmp_path / "numbers"
    with Journal(path, HEADER) as first:
        first.append({"number": 0})
        with pytest.raises(InvalidInputError, match="by another process"):
            Journal(path, HEADER)
    with Journal(path, HEADER) as second:
        second.append({"number": 1})
    assert (len(first), len(second), first[0], second[1]) == (1, 2, {"number": 0}, {"number": 1})


@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), KeyboardInterrupt()])
def test_what_cannot_be_written_leaves_nothing(tmp_path, monkeypatch, error):
    """A disk that is full, or Ctrl-C, half way through a line: the line is taken back, and the journal goes on."""
    path, write = tmp_path / "numbers", os.write

    def broken(file, data):
        if len(data) < 10:
            raise error
        return write(file, data[: len(data) // 2])

    with Journal(path, HEADER) as journal:
        journal.append({"number": 0})
        before = path.read_bytes()
        monkeypatch.setattr(os, "write", broken)
        with pytest.raises(KeyboardInterrupt if isinstance(error, KeyboardInterrupt) else InvalidInputError):
            journal.append({"number": 1})
        monkeypatch.undo()
        assert path.read_bytes() == before
        journal.append({"number": 2})
    assert [record["number"] for record in written(path, 0)] == [0, 2]


def test_a_file_changed_under_it_is_told(tmp_path):
    """A record that is gone is named, not made up."""
    journal = written(tmp_path / "numbers", 2)
    (tmp_path / "numbers").write_text("gone")
    with pytest.raises(InvalidInputError, match="was changed while it was in use"):
        journal[1]
