"""The reduced model of a closed-chain mechanism: D q̈ + C q̇ + g = u in the independent coordinates (Theorem 1)."""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, matrix_rows, vector
from ccpin.dynamics.derivatives import (
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.dynamics.free_system import Energy, FreeSystem
from ccpin.dynamics.state import Near, ReducedTerms, State
from ccpin.errors import InvalidInputError
from ccpin.kinematics.checked import checked_configuration, checked_q
from ccpin.kinematics.coordinates import IndependentCoordinates
from ccpin.kinematics.parametrization import ClosedPoint
from ccpin.mechanism.mechanism import Mechanism


class ReducedModel:
    """The reduced equations of motion D(q) q̈ + C(q, q̇) q̇ + g(q) = ρᵀSᵀu (22), q′ = σ(q), q̇′ = ρ q̇ (27).

    Where the actuated joints are the independent ones, ρᵀSᵀu = u as in the paper. `at` gives a `State`, which has all
    the rest; the methods below with a `guess` are shorthands for it, for one thing at one q. Nothing is remembered
    between calls, and any number of threads may share a model. SI units, radians.

    Args:
        mechanism: From `ccpin.load`.
        gravity: In world axes, m/s², three numbers; default the file's, else (0, 0, −9.81).

    Attributes:
        mechanism: The mechanism.
        gravity_vector: Gravity in world axes, m/s², of shape (3,).
        free_system: D′, C′, g′ (2), with that gravity.
        parametrization: σ, ρ, ρ̇. coordinates: α.
        n: Number of independent velocities. nq: size of q.
        n_actuated: Number of efforts u. actuation: S, of shape (motors, n′); ``None`` where u acts on q itself.

    Raises:
        InvalidInputError: Gravity is not three finite numbers.
    """

    def __init__(self, mechanism: Mechanism, gravity: ArrayLike | None = None) -> None:
        self.mechanism = mechanism
        given = mechanism.description.gravity if gravity is None else vector(gravity, "gravity", 3)
        self.gravity_vector = frozen(given)
        self.free_system = FreeSystem(mechanism.tree, self.gravity_vector)
        self.parametrization = mechanism.parametrization()
        self.coordinates = self.parametrization.coordinates
        self.n = self.coordinates.n
        self.nq = self.coordinates.nq
        self.actuation = None if mechanism.direct else frozen(mechanism.actuation)
        self.n_actuated = self.n if self.actuation is None else len(self.actuation)

    def __repr__(self) -> str:
        return f"ReducedModel({self.mechanism!r})"

    def at(self, q: ArrayLike | State, near: Near = None) -> State:
        """The closed configuration q′ = σ(q) (12) on a branch, with the reduced model there.

        Args:
            q: Independent coordinates, of shape (model.nq,). A State of this mechanism stands for itself.
            near: On the branch wanted: a State of this mechanism or a configuration q′, closed or nearly so; default
                the mechanism's reference. The nearer it is, the shorter the way.

        Raises:
            InvalidInputError: Wrong shape, not finite, a State of another mechanism, or a configuration that cannot
                be closed.
            UnreachableError: The straight line to q is blocked by a singularity.
            SingularConfigurationError: q is singular.
        """
        if isinstance(q, State):
            return q if q.model is self else State(self, q.q, self._own(q)._point)
        wanted = np.array(checked_q(self.coordinates, q))
        return State(self, wanted, self.parametrization.sigma(wanted, self._start(near)))

    def alpha(self, q_free: ArrayLike) -> Array:
        """q = α(q′) (7), of shape (model.nq,)."""
        return self.coordinates.alpha(self._configuration(q_free))

    def rho(self, q_free: ArrayLike) -> Array:
        """ρ = ψ_q′⁻¹ [0; I] (14), of shape (n′, n), with q̇′ = ρ q̇.

        Raises:
            SingularConfigurationError: ψ_q′ has not full rank at q′.
        """
        return self.parametrization.at(self._configuration(q_free)).rho

    def rho_dot(self, q_free: ArrayLike, v_free: ArrayLike) -> Array:
        """ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ (35), of shape (n′, n), along q̇′.

        Raises:
            SingularConfigurationError: ψ_q′ has not full rank at q′.
        """
        point = self.parametrization.at(self._configuration(q_free))
        return self.parametrization.rho_dot(point, vector(v_free, "v_free", self.mechanism.n_free))

    # Shorthands: one thing at one q. Errors are those of `at` and of the State's method.

    def sigma(self, q: ArrayLike, guess: Near = None) -> Array:
        """q′ = σ(q) (12), of shape (nq,), on the branch of `guess`: a copy of `State.q_free`."""
        return self.at(q, guess).q_free.copy()

    def terms(self, q: ArrayLike, v: ArrayLike, guess: Near = None) -> ReducedTerms:
        """D, C, g (23)–(25) and what they come from: `State.terms`."""
        return self.at(q, guess).terms(v)

    def gravity(self, q: ArrayLike, guess: Near = None) -> Array:
        """g(q) = ρᵀg′(σ(q)) (25), of shape (n,): `State.g`."""
        return self.at(q, guess).g

    def gravity_derivative(self, q: ArrayLike, guess: Near = None) -> Array:
        """∂g/∂q, of shape (n, n): `State.gravity_derivative`."""
        return self.at(q, guess).gravity_derivative

    def energy(self, q: ArrayLike, v: ArrayLike, guess: Near = None) -> Energy:
        """½ q̇ᵀD q̇ and V, in joules: `State.energy`."""
        return self.at(q, guess).energy(v)

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, u: ArrayLike, guess: Near = None) -> Array:
        """q̈ = D⁻¹(ρᵀSᵀu − C q̇ − g) (22), of shape (n,): `State.forward_dynamics`."""
        return self.at(q, guess).forward_dynamics(v, u)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, guess: Near = None) -> Array:
        """u with ρᵀSᵀu = D q̈ + C q̇ + g (22), of shape (motors,): `State.inverse_dynamics`."""
        return self.at(q, guess).inverse_dynamics(v, a)

    def constraint_forces(self, q: ArrayLike, v: ArrayLike, u: ArrayLike, guess: Near = None) -> Array:
        """λ of the descriptor form (17), of shape (m,): `State.constraint_forces`."""
        return self.at(q, guess).constraint_forces(v, u)

    def forward_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, guess: Near = None
    ) -> ForwardDynamicsDerivatives:
        """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂u: `State.forward_dynamics_derivatives`."""
        return self.at(q, guess).forward_dynamics_derivatives(v, u)

    def inverse_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, guess: Near = None
    ) -> InverseDynamicsDerivatives:
        """∂u/∂q, ∂u/∂q̇ and ∂u/∂q̈: `State.inverse_dynamics_derivatives`."""
        return self.at(q, guess).inverse_dynamics_derivatives(v, a)

    def generalized_force_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, guess: Near = None
    ) -> GeneralizedForceDerivatives:
        """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of τ = D q̈ + C q̇ + g: `State.generalized_force_derivatives`."""
        return self.at(q, guess).generalized_force_derivatives(v, a)

    def sigma_many(self, Q: ArrayLike, guess: Near = None) -> Array:
        """σ of each row of Q (N, model.nq), of shape (N, nq); each row as if asked for alone."""
        rows = matrix_rows(Q, "Q", self.nq)
        return np.array([self.sigma(q, guess) for q in rows]).reshape(len(rows), self.mechanism.nq)

    def terms_many(self, Q: ArrayLike, V: ArrayLike, guess: Near = None) -> ReducedTerms:
        """`terms` of each row of Q and V; every field has a leading axis of length N."""
        rows, velocities = _together(matrix_rows(Q, "Q", self.nq), matrix_rows(V, "V", self.n))
        n_free, n = self.mechanism.n_free, self.n
        shapes = ((self.mechanism.nq,), (n_free,), (n_free, n), (n_free, n), (n, n), (n, n), (n,))
        each = [self.terms(q, v, guess) for q, v in zip(rows, velocities, strict=True)]
        columns = zip(*each, strict=True) if each else [()] * len(shapes)
        return ReducedTerms(
            *(np.reshape(column, (len(rows), *shape)) for column, shape in zip(columns, shapes, strict=True))
        )

    def forward_dynamics_many(self, Q: ArrayLike, V: ArrayLike, U: ArrayLike, guess: Near = None) -> Array:
        """`forward_dynamics` of each row of Q, V and U, of shape (N, n)."""
        rows = _together(
            matrix_rows(Q, "Q", self.nq), matrix_rows(V, "V", self.n), matrix_rows(U, "U", self.n_actuated)
        )
        each = [self.forward_dynamics(q, v, u, guess) for q, v, u in zip(*rows, strict=True)]
        return np.array(each).reshape(len(rows[0]), self.n)

    def _configuration(self, q_free: ArrayLike, name: str = "q_free") -> Array:
        return checked_configuration(self.free_system.model, q_free, name)

    def _start(self, near: Near) -> Array | ClosedPoint | None:
        if isinstance(near, State):
            return self._own(near)._point
        return None if near is None else self._configuration(near, "guess")

    def _own(self, state: State) -> State:
        if state.model.mechanism is not self.mechanism:
            raise InvalidInputError(
                f"a State of '{state.model.mechanism.name}' is none of '{self.mechanism.name}' as loaded for this "
                "model; pass its q_free"
            )
        return state


def model_of(subject: Mechanism | ReducedModel) -> ReducedModel:
    """The model where one is wanted: itself, or a mechanism's with the file's gravity."""
    return subject if isinstance(subject, ReducedModel) else ReducedModel(subject)


def coordinates_of(subject: Mechanism | ReducedModel) -> IndependentCoordinates:
    """The independent coordinates of a mechanism or a model."""
    return subject.coordinates if isinstance(subject, ReducedModel) else subject.parametrization().coordinates


def _together(*arrays: Array) -> tuple[Array, ...]:
    if len({len(array) for array in arrays}) != 1:
        raise InvalidInputError(f"arrays of different lengths: {', '.join(str(len(a)) for a in arrays)}")
    return arrays
