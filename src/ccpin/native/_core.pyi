"""The compiled core: what one mechanism's numbers say at a state, and certificates of boxes.

Every method of a `Kernel` answers, or returns ``None`` where only the reference can answer or explain. `near` is a
configuration on the branch wanted (``None``: the reference); with q the answer is for σ(q) from there, without q for
`near` itself, which must be closed. `wrenches` on links are rows of `ccpin.dynamics.wrenches.wrench_rows`. Arrays are
new, float64 and row-major.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from ccpin.arrays import Array

Near = ArrayLike | None
Pair = tuple[Array, Array]
Triple = tuple[Array, Array, Array]
Terms = tuple[Array, Array, Array, Array, Array, Array, Array]
Mask = NDArray[np.bool_]
Integers = NDArray[np.int64]

class Kernel:
    def __init__(self, specification: dict[str, object]) -> None: ...
    def constraints(self, q_free: ArrayLike) -> Pair | None:
        """φ (m,) and φ_q′ (m, n′) at any configuration."""

    def constraint_rate(self, q_free: ArrayLike, v_free: ArrayLike) -> Array | None:
        """d/dt φ_q′ along q̇′, of shape (m, n′), at any configuration."""

    def sigma(self, q: ArrayLike, near: Near = None) -> Array | None:
        """q′ = σ(q) (12), of shape (nq,)."""

    def closed_point(self, near: Near, q: ArrayLike | None = None) -> Pair | None:
        """q′ and ρ (14), of shape (n′, n)."""

    def blocked(self, near: Near, q: ArrayLike) -> tuple[float, Array, float] | None:
        """After a σ that was refused: how much of the straight line to q leads next to where it ends.

        Then q′ there, and the reciprocal condition number of ψ_q′. ``None``: that was not found.
        """

    def rcond(self, q_free: ArrayLike) -> float | None:
        """Reciprocal condition number of ψ_q′ in the 1-norm."""

    def terms(self, near: Near, v: ArrayLike, q: ArrayLike | None = None) -> Terms | None:
        """The fields of `ReducedTerms`, in order."""

    def forward_dynamics(
        self, near: Near, v: ArrayLike, u: ArrayLike, q: ArrayLike | None = None, wrenches: ArrayLike | None = None
    ) -> Array | None:
        """q̈ (22), of shape (n,)."""

    def generalized_force(
        self, near: Near, v: ArrayLike, a: ArrayLike, q: ArrayLike | None = None, wrenches: ArrayLike | None = None
    ) -> Array | None:
        """τ = D q̈ + C q̇ + damping q̇ + g − ρᵀJᵀw, of shape (n,)."""

    def inverse_dynamics(
        self, near: Near, v: ArrayLike, a: ArrayLike, q: ArrayLike | None = None, wrenches: ArrayLike | None = None
    ) -> Array | None:
        """The actuated joints' efforts u of least norm, of shape (motors,); ``None`` where they may not suffice."""

    def regressor(
        self, near: Near, v: ArrayLike, a: ArrayLike, v_r: ArrayLike, q: ArrayLike | None = None
    ) -> Array | None:
        """Y_r, of shape (n, constants): `State.regressor`."""

    def gravity(self, near: Near, q: ArrayLike | None = None) -> Array | None:
        """g (25), of shape (n,)."""

    def transmission(self, near: Near, q: ArrayLike | None = None) -> Array | None:
        """ρᵀSᵀ, of shape (n, motors)."""

    def constraint_forces(
        self, near: Near, v: ArrayLike, u: ArrayLike, q: ArrayLike | None = None, wrenches: ArrayLike | None = None
    ) -> Array | None:
        """λ (17), of shape (m,)."""

    def bearing_forces(
        self, near: Near, v: ArrayLike, u: ArrayLike, q: ArrayLike | None = None, wrenches: ArrayLike | None = None
    ) -> Triple | None:
        """What closures (L, 6) and joints (joints, 6) carry, and the joints' world poses (joints + 1, 4, 4).

        (force, moment) in world axes: on a closure's end A about its closure point, on a joint's child about its
        origin.
        """

    def energy(self, near: Near, v: ArrayLike, q: ArrayLike | None = None) -> tuple[float, float] | None:
        """Kinetic and potential energy in joules."""

    def generalized_force_derivatives(
        self, near: Near, v: ArrayLike, a: ArrayLike, q: ArrayLike | None = None, wrenches: ArrayLike | None = None
    ) -> Triple | None:
        """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ = D, each (n, n)."""

    def forward_dynamics_derivatives(
        self, near: Near, v: ArrayLike, u: ArrayLike, q: ArrayLike | None = None, wrenches: ArrayLike | None = None
    ) -> Triple | None:
        """∂q̈/∂q, ∂q̈/∂q̇ (n, n) and ∂q̈/∂u (n, motors)."""

    # Batches: the answers, with a leading axis, and a mask of the rows answered; the others are NaN.

    def sigma_many(self, Q: ArrayLike, near: Near, threads: int = 1) -> tuple[Array, Mask] | None: ...
    def terms_many(self, Q: ArrayLike, V: ArrayLike, near: Near, threads: int = 1) -> tuple[Terms, Mask] | None: ...
    def forward_dynamics_many(
        self, Q: ArrayLike, V: ArrayLike, U: ArrayLike, near: Near, threads: int = 1
    ) -> tuple[Array, Mask] | None: ...
    def generalized_force_many(
        self, Q: ArrayLike, V: ArrayLike, A: ArrayLike, near: Near, threads: int = 1
    ) -> tuple[Array, Mask] | None: ...
    def inverse_dynamics_many(
        self, Q: ArrayLike, V: ArrayLike, A: ArrayLike, near: Near, threads: int = 1
    ) -> tuple[Array, Mask] | None: ...
    def regressor_many(
        self, Q: ArrayLike, V: ArrayLike, A: ArrayLike, V_r: ArrayLike, near: Near, threads: int = 1
    ) -> tuple[Array, Mask] | None: ...
    def forward_dynamics_derivatives_many(
        self, Q: ArrayLike, V: ArrayLike, U: ArrayLike, near: Near, threads: int = 1
    ) -> tuple[Triple, Mask] | None: ...
    def simulate(
        self,
        near: Near,
        law: dict[str, object],
        run: dict[str, object],
        tableau: dict[str, object],
        nominal: Kernel | None = None,
        nominal_near: Near = None,
    ) -> tuple[Any, ...] | None:
        """A run under a law, sampled; `nominal` is the kernel of its model where that is another than the plant's.

        The number of samples, then t, q, q̇, q̈, u, q′, q̇′, |φ| and q̈′ at each, how it ended, since when it is settled,
        evaluations, what a signal's handler raised, what a sampled loop remembers; then where it has come to: time,
        (q, q̇), q′, the step it would take next, how many steps in a row were next to nothing, as in
        `ccpin.simulation.integration.core_runs.CoreRun`, which says what the arguments hold, too.
        """

    def learnt(
        self,
        law: dict[str, object],
        sampling: dict[str, object],
        t: ArrayLike,
        Q: ArrayLike,
        V: ArrayLike,
        Q_free: ArrayLike,
    ) -> tuple[Array, Array] | None:
        """An adaptive law asked again at N samples: π̂ as each used it (N, k), u held from there on (N, n)."""

    def held_motion(
        self,
        home: Kernel,
        tableau: dict[str, object],
        rtol: float,
        atol: float,
        max_step: float,
        singular_rcond: float,
        wrenches: ArrayLike | None = None,
        leaving: dict[str, object] | None = None,
    ) -> HeldMotion:
        """A motion to be stepped with u held, and told in the coordinates of `home`, the same mechanism's.

        `leaving` tells poor coordinates (`ccpin.simulation.integration.coordinate_switching`).
        """

class HeldMotion:
    """A motion that is stepped with u held; one thread may use it at a time.

    Attributes:
        evaluations: Of the equations of motion so far. last_step: what the integrator would try next, s.
    """

    evaluations: int
    last_step: float

    def start(self, q_free: ArrayLike | None, q: ArrayLike, v: ArrayLike, first: float, most: float) -> bool:
        """Begin at a closed configuration with a first step (0: one of its own); whether the core can.

        Steps have no answer where the coordinates' leverage gets beyond `most`.
        """

    def step(
        self, u: ArrayLike, dt: float
    ) -> tuple[Array, Array, Array, Array, Array, Array, float, float, BaseException | None] | None:
        """q, q̇, q̈ of `home`, u, q′, q̇′ (read-only), |φ| after dt; ``None``: the reference tells, `start` again then.

        Then how much of dt a signal let it have, and what the signal's handler raised.
        """

    def state(self) -> Array:
        """(q, q̇) in the kernel's own coordinates after the last step that had an answer."""

Columns = tuple[Array, ...]  # the fields of ccpin.domain.boxes.Boxes

class Certifier:
    """Certificates for closures in plain numbers (`ccpin.domain.in_core.numbers_of`)."""

    def __init__(self, numbers: dict[str, object]) -> None: ...
    def values(self, theta: Array) -> Pair:
        """φ (B, m) and φ_θ (B, m, n′) at θ (B, n′)."""

    def derivatives(self, theta: Array) -> tuple[Array, Array, Array, Array]:
        """The fields of `ccpin.domain.chain_stack.Derivatives` at θ (B, n′)."""

    def bounds(self, boxes: Columns) -> Triple:
        """Y, Z̄(R)R and Z(R)w of boxes as they are, each (B, m)."""

    def newton(self, theta: Array, iterations: int, accuracy: float) -> tuple[Array, Mask, Array]:
        """θ, whether Newton settled and slopes one step before: the fields of `ccpin.domain.newton.Converged`."""

    def certify_boxes(self, centre: Array, half: Array, across: Array) -> tuple[Columns, Mask]:
        """Boxes and which are proved: see `ccpin.domain.boxes.certify_boxes`."""

    def certify_points(self, theta: Array) -> tuple[Columns, Mask]:
        """Boxes and which are proved: see `ccpin.domain.boxes.certify_points`."""

    def glued(self, first: Columns, delta: Array, second: Columns, delta_second: Array) -> Mask:
        """See `ccpin.domain.newton.glued`."""

def contacts(
    lower: Integers, size: Integers, cut: Integers, child: Integers, cells: Integers, wrapped: list[bool]
) -> tuple[Integers, Integers, Array, Array, Array, Mask]:
    """The fields of `ccpin.domain.atlas.cells.Contacts` for cells of a tree (the fields of its `Cells`)."""
