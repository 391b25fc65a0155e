"""Certificates on disk, altered."""

import json

import numpy as np

from ccpin.auditing import document


def changed(path, tmp_path, change, stamp=True):
    """The document with arrays changed; its fingerprint brought up to date unless told otherwise."""
    whole = json.loads(path.read_text())
    arrays = {n: np.array(a["data"], dtype=a["dtype"]).reshape(a["shape"]) for n, a in whole["arrays"].items()}
    change(arrays)
    whole["arrays"] = {
        n: {"dtype": str(a.dtype), "shape": a.shape, "data": a.ravel().tolist()} for n, a in arrays.items()
    }
    if stamp:
        whole["fingerprint"] = document.fingerprint(arrays)
    other = tmp_path / "changed.json"
    other.write_text(json.dumps(whole))
    return other
