"""A kept result is found by what it was computed from, every bit of it, and by the code; by nothing less."""

import hashlib
import json
import shutil
import threading

import numpy as np
import pytest

from ccpin.covering import runner, sources
from ccpin.covering.runner import ChunkStore, Runner
from tests.support.straight import circles, problem_by_hand, straight

CIRCLE = problem_by_hand(circles())
LINE = problem_by_hand(straight([[1.0]]))


def double(problem, arrays):
    return tuple(2.0 * array for array in arrays)


def triple(problem, arrays):
    return tuple(3.0 * array for array in arrays)


NUMBERS = np.arange(6.0)


def test_whatever_differs_has_another_key(tmp_path, monkeypatch):
    def key(arrays=(NUMBERS,), task=double, problem=CIRCLE):
        return ChunkStore(tmp_path, problem).key(task, arrays)

    zero, next_to = np.zeros(6), NUMBERS.copy()
    next_to[-1] = np.nextafter(next_to[-1], 9.0)
    keys = [
        key(),
        key(task=triple),
        key(problem=LINE),
        key(problem=problem_by_hand(straight([[np.nextafter(1.0, 2.0)]]))),
        key((next_to,)),
        key((NUMBERS.reshape(2, 3),)),
        key((NUMBERS.reshape(3, 2),)),
        key((NUMBERS[:3], NUMBERS[3:])),
        key((NUMBERS[3:], NUMBERS[:3])),
        key((zero,)),
        key((-zero,)),
        key((zero.astype(np.int64),)),
        key((zero > 0.0,)),
        key((zero[:1] > 0.0, zero[1:])),
        key(()),
    ]
    monkeypatch.setattr(runner, "code_digest", lambda: b"other code")
    keys.append(key())
    assert len({*keys}) == len(keys)


def test_what_is_the_same_has_the_same_key(tmp_path):
    """However it lies in memory, and whoever asks."""
    table = np.arange(12.0).reshape(3, 4)
    keys = [ChunkStore(tmp_path, CIRCLE).key(double, (a,)) for a in (table, np.asfortranarray(table), table.T.copy().T)]
    assert len({*keys}) == 1
    assert ChunkStore(None, CIRCLE).key(double, (table,)) == ""


def test_only_what_was_kept_under_a_name_is_read_from_it(tmp_path):
    """Neither another's file, nor one that is damaged anywhere, nor one with another format, nor one that says more."""
    store = ChunkStore(tmp_path, CIRCLE)
    ours, theirs = store.key(double, (NUMBERS,)), store.key(triple, (NUMBERS,))
    assert store.load(ours) is None
    store.save(ours, (NUMBERS, NUMBERS > 2.0))
    for found, kept in zip(store.load(ours), (NUMBERS, NUMBERS > 2.0), strict=True):
        np.testing.assert_array_equal(found, kept)
        assert found.dtype == kept.dtype
    file = tmp_path / f"{ours}.chunk"
    shutil.copy(file, tmp_path / f"{theirs}.chunk")
    assert store.load(theirs) is None
    whole = file.read_bytes()
    flipped = [whole[:k] + bytes([whole[k] ^ 1]) + whole[k + 1 :] for k in range(len(whole))]
    for damaged in (b"", whole[:-1], whole + b"0", *flipped):
        file.write_bytes(damaged)
        assert store.load(ours) is None
    for wrong in ({}, {"format": "ccpin-chunk-0"}, {"key": theirs}, {"more": 1}, {"arrays": [["<f8", [7]]]}):
        header = {"format": "ccpin-chunk-2", "key": ours, "arrays": [["<f8", [2, 3]]]} | wrong
        below = json.dumps(header).encode() + b"\n" + NUMBERS.tobytes()
        file.write_bytes(hashlib.sha256(below).hexdigest().encode() + b"\n" + below)
        if wrong:
            assert store.load(ours) is None
        else:
            np.testing.assert_array_equal(store.load(ours), [NUMBERS.reshape(2, 3)])
            store.load(ours)[0][:] = 0.0  # it is the caller's


@pytest.mark.parametrize("shape", [(), (0, 3), (2, 0), (1,), (2, 3, 4)])
@pytest.mark.parametrize("dtype", ["float64", "int64", "int8", "bool"])
def test_results_of_any_shape_are_kept_bit_for_bit(tmp_path, shape, dtype):
    """One behind the other, however they lie in memory."""
    store, rng = ChunkStore(tmp_path, CIRCLE), np.random.default_rng(3)
    given = tuple((40.0 * rng.normal(size=shape)).astype(dtype).T for _ in range(2))
    store.save("key", (*given, NUMBERS))
    for found, kept in zip(store.load("key"), (*given, NUMBERS), strict=True):
        assert (found.dtype, found.shape, found.tobytes()) == (kept.dtype, kept.shape, kept.tobytes())


@pytest.mark.parametrize("kept", [[], [1], [0, 2], [0, 1, 2, 3]])
def test_results_are_in_order_whichever_were_kept(tmp_path, kept):
    """Those that were are not computed again; those that were not are kept."""
    asked = []

    def task(problem, arrays):
        assert problem is CIRCLE
        asked.append(int(arrays[0][0]))
        return double(problem, arrays)

    chunks = [(np.array([float(k)]),) for k in range(4)]
    folder = Runner(CIRCLE, None, tmp_path, threading.Event())
    for k in kept:
        folder.store.save(folder.store.key(task, chunks[k]), double(CIRCLE, chunks[k]))
    for again in range(2):
        asked.clear()
        assert [float(found[0][0]) for found in folder.map(task, chunks)] == [0.0, 2.0, 4.0, 6.0]
        assert asked == ([] if again else [k for k in range(4) if k not in kept])
    assert [found[0][0] for found in Runner(CIRCLE, None, None, threading.Event()).map(task, chunks)] == [0, 2, 4, 6]


def test_every_byte_of_the_code_counts(tmp_path, monkeypatch):
    """And which file it is in."""
    home = tmp_path / "ccpin"
    for room in (*sources._ROOMS, "others"):
        file = home / room if room.endswith(".py") else home / room / "inner" / "code.py"
        file.parent.mkdir(parents=True, exist_ok=True)
        file.write_text(f"room = {room!r}\n")
    core = tmp_path / "core.so"
    core.write_bytes(b"compiled")
    monkeypatch.setattr(sources, "__file__", str(home / "covering" / "sources.py"))

    def digest(compiled="", rooms=()):
        return sources._digest.__wrapped__(compiled, rooms)

    as_it_is = digest()
    found = [as_it_is, digest(str(core)), digest(rooms=("others",))]
    core.write_bytes(b"compiled anew")
    found.append(digest(str(core)))
    for file in sorted(home.rglob("*.py")):
        before = file.read_bytes()
        file.write_bytes(before + b" ")
        changed = digest()
        if "others" in file.parts:
            assert changed == as_it_is
        else:
            found.append(changed)
        file.write_bytes(before)
    assert digest() == as_it_is
    (home / "proof" / "inner" / "code.py").rename(home / "proof" / "inner" / "other.py")
    found.append(digest())
    monkeypatch.setattr(np, "__version__", "0")
    found.append(digest())
    assert len({*found}) == len(found) == len(sources._ROOMS) + 6
