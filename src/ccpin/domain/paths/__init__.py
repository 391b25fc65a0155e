"""One way followed by proved boxes: a path along which σ is certified, or what refutes that there is one."""
