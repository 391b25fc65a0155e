"""Where σ is unique and nonsingular: Theorem 2, certificates, atlas, singularities."""
