"""What is written is there whole or not at all; what is in journals is read again after whatever ended the writing."""

import os
import stat
import subprocess
import sys
import threading

import pytest

import ccpin
from ccpin import auditing, domain
from ccpin.errors import InvalidInputError
from ccpin.files import Journal, write_atomically

HEADER = {"format": "test-1", "task": "count"}


def written(path, count):
    with Journal(path, HEADER) as journal:
        for k in range(count):
            journal.append({"number": k, "text": "ä" * k})
    return journal


def saved(path, text="new"):
    write_atomically(path, "w", lambda file: file.write(text))


def test_permissions_are_kept(tmp_path):
    """Of a file that is replaced; a new one has those that the process gives to what it makes."""
    path = tmp_path / "result.json"
    before = os.umask(0o027)
    try:
        saved(path)
    finally:
        os.umask(before)
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    path.chmod(0o600)
    saved(path, "newer")
    assert (stat.S_IMODE(path.stat().st_mode), path.read_text()) == (0o600, "newer")


@pytest.mark.parametrize("there", [True, False])
def test_a_link_stays_a_link(tmp_path, there):
    """Written is what it points to."""
    target, link = tmp_path / "target", tmp_path / "link"
    if there:
        target.write_text("old")
    link.symlink_to(target.name)
    saved(link)
    assert link.is_symlink()
    assert target.read_text() == "new"


def test_a_pipe_is_written_into(tmp_path):
    """It is a pipe afterwards, too."""
    path, read = tmp_path / "pipe", []
    os.mkfifo(path)
    reader = threading.Thread(target=lambda: read.append(path.read_text()))
    reader.start()
    saved(path)
    reader.join()
    assert read == ["new"]
    assert path.is_fifo()


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no device that is always full")
def test_a_full_device_is_told(tmp_path):
    """And is the device afterwards."""
    link = tmp_path / "result.npz"
    link.symlink_to("/dev/full")
    with pytest.raises(InvalidInputError, match="No space left"):
        saved(link)
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)
    assert list(tmp_path.iterdir()) == [link]


@pytest.mark.skipif(not hasattr(os, "O_TMPFILE"), reason="files have names from the beginning here")
def test_a_killed_save_leaves_nothing(tmp_path):
    """Neither half a file nor one under another name."""
    path = tmp_path / "result.npz"
    program = (
        "import os, signal\nfrom ccpin.files import write_atomically\n"
        "def write(file):\n    file.write('half')\n    file.flush()\n    os.kill(os.getpid(), signal.SIGKILL)\n"
        f"write_atomically({str(path)!r}, 'w', write)\n"
    )
    assert subprocess.run([sys.executable, "-c", program], check=False).returncode == -9
    assert list(tmp_path.iterdir()) == []


def test_an_interrupted_save_leaves_what_was_there(tmp_path):
    """Whatever interrupts it."""
    path = tmp_path / "result.npz"
    saved(path, "old")

    def write(file):
        file.write("half")
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write_atomically(path, "w", write)
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("result.npz", "old")]


def test_systems_without_nameless_files(tmp_path, monkeypatch):
    """They write under another name first."""
    monkeypatch.delattr(os, "O_TMPFILE", raising=False)
    saved(tmp_path / "result")
    saved(tmp_path / "result", "newer")
    assert [(p.name, p.read_text()) for p in tmp_path.iterdir()] == [("result", "newer")]


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


def test_nobody_waits_for_a_pipe(tmp_path):
    """Documents, motions and journals are read from regular files; a pipe into which nobody writes held for ever."""
    path = tmp_path / "pipe.npz"
    os.mkfifo(path)
    for read in (domain.Atlas.load, ccpin.Trajectory.load, lambda file: list(auditing.verify(file).claims)):
        with pytest.raises(InvalidInputError, match="no regular file"):
            read(path)
    with pytest.raises(InvalidInputError, match="no regular file"):
        Journal(path, {"format": "anything"})
