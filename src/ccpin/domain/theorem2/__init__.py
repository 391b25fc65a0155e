"""The paper's Theorem 2: the quadratic form and its radius."""
