"""Closed forms of the mechanisms in ``models/``, written from their geometry with NumPy alone.

One module a mechanism. Each restates the dimensions (an independent copy of the file's) and offers

* ``INDEPENDENT``: the independent joints, ``N_FREE``: n′, ``RANK``: the rank n′ − n of the closures;
* ``configuration(p)``: a closed configuration in the file's assembly mode, as displacements by joint name, for
  parameters p (as many as the mobility) anywhere in ``BOX``, the rows of which are (lowest, highest);

beside the classical solution of the mechanism itself.
"""
