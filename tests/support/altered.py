"""Certificates on disk, altered."""

import json

import numpy as np

from ccpin.auditing import reading
from ccpin.containers import checksum


def changed(path, tmp_path, change, stamp=True, **header):
    """The document with arrays changed, and what of its header is named; its checksum is brought up to date.

    So is its fingerprint, unless `stamp` is false.
    """
    whole = json.loads(path.read_text())
    arrays = {n: np.array(a["data"], dtype=a["dtype"]).reshape(a["shape"]) for n, a in whole["arrays"].items()}
    change(arrays)
    whole["arrays"] = {
        n: {"dtype": str(a.dtype), "shape": a.shape, "data": a.ravel().tolist()} for n, a in arrays.items()
    }
    if stamp:
        whole["fingerprint"] = reading.fingerprint(arrays)
    whole |= header
    said = {name: value for name, value in whole.items() if name != "arrays"}
    whole["checksum"] = checksum(said, arrays)
    other = tmp_path / "changed.json"
    other.write_text(json.dumps(whole))
    return other


def without_boxes(arrays, cells):
    """An atlas's arrays without the boxes of some certified cells, the others numbered anew."""
    number = _without(arrays, arrays["tree_box"][cells])
    arrays["tree_box"][cells] = -1
    arrays["tree_box"][:] = number[arrays["tree_box"]]
    arrays["unglued"] = arrays["unglued"][:0]


def without_members(arrays, cells):
    """Sheets' arrays without the boxes over some cells, the others numbered anew."""
    stay = ~np.isin(arrays["members_cell"], cells)
    number = _without(arrays, arrays["members_box"][~stay])
    for name in ("members_cell", "members_box"):
        arrays[name] = arrays[name][stay]
    arrays["members_box"] = number[arrays["members_box"]]
    rows = (number[arrays["glued_first"]] >= 0) & (number[arrays["glued_second"]] >= 0)
    for name in ("glued_first", "glued_second", "glued_at_first", "glued_at_second"):
        arrays[name] = arrays[name][rows]
    for name in ("glued_first", "glued_second"):
        arrays[name] = number[arrays[name]]


def _without(arrays, lost):
    """The new numbers of all boxes, −1 of those that are lost (and of −1); the arrays lose them."""
    count = len(arrays["box_centre"])
    kept = np.setdiff1d(np.arange(count), lost)
    number = np.full(count + 1, -1)
    number[kept] = np.arange(len(kept))
    for name in [name for name in arrays if name.startswith("box_")]:
        arrays[name] = arrays[name][kept]
    return number


def claim(audit, word):
    """The claim of an audit whose words hold one."""
    return next(c for c in audit.claims if word in c.what)
