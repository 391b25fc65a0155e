"""The reduced model of a closed-chain mechanism: D q̈ + C q̇ + g = u in the independent coordinates (Theorem 1)."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike
from scipy.linalg import lapack

from ccpin.arrays import Array
from ccpin.dynamics.derivatives import (
    DynamicsDerivatives,
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.dynamics.free_system import Energy, FreeSystem
from ccpin.errors import (
    InvalidInputError,
    SingularConfigurationError,
    UnderactuatedError,
    UnsupportedMechanismError,
)
from ccpin.kinematics.parametrization import ClosedPoint
from ccpin.mechanism.mechanism import Mechanism


class ReducedTerms(NamedTuple):
    """The reduced model at one state (q, q̇).

    Attributes:
        q_free: q′ = σ(q), of shape (nq,).
        v_free: q̇′ = ρ q̇ (13), of shape (n′,).
        rho: ρ (14), of shape (n′, n).
        rho_dot: ρ̇ (35), of shape (n′, n).
        D: ρᵀD′ρ (23), symmetric positive definite, of shape (n, n).
        C: ρᵀC′ρ + ρᵀD′ρ̇ (24), of shape (n, n); Ḋ − 2C is skew symmetric (Lemma III.1).
        g: ρᵀg′ (25), of shape (n,).
    """

    q_free: Array
    v_free: Array
    rho: Array
    rho_dot: Array
    D: Array
    C: Array
    g: Array


class ReducedModel:
    """The reduced equations of motion D(q) q̈ + C(q, q̇) q̇ + g(q) = ρᵀSᵀu (22), q′ = σ(q), q̇′ = ρ q̇ (27).

    Where the actuated joints are the independent ones, ρᵀSᵀu = u as in the paper. Every method is a pure function
    of its arguments: a `guess` chooses the assembly mode and shortens the way, nothing is remembered between calls.
    SI units, radians. Scratch memory is shared inside: one instance a thread.

    Args:
        mechanism: From `ccpin.load`.
    """

    def __init__(self, mechanism: Mechanism) -> None:
        self.mechanism = mechanism
        self.free_system = FreeSystem(mechanism.tree)
        self.parametrization = mechanism.parametrization()
        self.coordinates = self.parametrization.coordinates
        self.n = self.coordinates.n
        self.nq = self.coordinates.nq
        self._direct = mechanism.actuated == mechanism.independent
        self._actuation = np.eye(self.n) if self._direct else mechanism.actuation
        self.n_actuated = len(self._actuation)

    def alpha(self, q_free: ArrayLike) -> Array:
        """Q = α(q′) (7), of shape (nq_independent,)."""
        return self.coordinates.alpha(self.checked_configuration(q_free))

    def sigma(self, q: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """q′ = σ(q) (12), of shape (nq,), on the branch of `guess` (default: the mechanism's reference).

        Raises:
            InvalidInputError: Wrong shape, not finite, or a guess that cannot be closed.
            UnreachableError: The straight line from the guess to q is blocked by a singularity.
            SingularConfigurationError: q is singular.
        """
        return self.closed_point(q, guess).q_free

    def closed_point(self, q: ArrayLike, guess: ArrayLike | None = None) -> ClosedPoint:
        """σ(q) together with ρ and the factorised ψ_q′ there; errors as for `sigma`."""
        start = None if guess is None else self.checked_configuration(guess, "guess")
        return self.parametrization.sigma(self.checked_q(q), start)

    def rho(self, q_free: ArrayLike) -> Array:
        """ρ = ψ_q′⁻¹ [0; I] (14), of shape (n′, n), with q̇′ = ρ q̇.

        Raises:
            SingularConfigurationError: ψ_q′ has not full rank at q′.
        """
        return self.parametrization.at(self.checked_configuration(q_free)).rho

    def rho_dot(self, q_free: ArrayLike, v_free: ArrayLike) -> Array:
        """ρ̇ = −ψ_q′⁻¹ ψ̇_q′ ρ (35), of shape (n′, n), along q̇′.

        Raises:
            SingularConfigurationError: ψ_q′ has not full rank at q′.
        """
        point = self.parametrization.at(self.checked_configuration(q_free))
        return self.parametrization.rho_dot(point, self.checked(v_free, "v_free", self.mechanism.n_free))

    def terms(self, q: ArrayLike, v: ArrayLike, guess: ArrayLike | None = None) -> ReducedTerms:
        """D, C, g (23)–(25) and what they come from; errors as for `sigma`."""
        point = self.closed_point(q, guess)
        q_free, rho = point.q_free, point.rho
        v_free = rho @ self.checked(v, "v", self.n)
        rho_dot = self.parametrization.rho_dot(point, v_free)
        mass_rho = self.free_system.mass_matrix(q_free) @ rho
        coriolis = self.free_system.coriolis_matrix(q_free, v_free)
        return ReducedTerms(
            q_free=q_free,
            v_free=v_free,
            rho=rho,
            rho_dot=rho_dot,
            D=rho.T @ mass_rho,
            C=rho.T @ (coriolis @ rho) + mass_rho.T @ rho_dot,
            g=rho.T @ self.free_system.gravity(q_free),
        )

    def gravity(self, q: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """g(q) = ρᵀg′(σ(q)) (25), of shape (n,); errors as for `sigma`."""
        point = self.closed_point(q, guess)
        return np.asarray(point.rho.T @ self.free_system.gravity(point.q_free))

    def generalized_force(self, point: ClosedPoint, u: ArrayLike) -> Array:
        """ρᵀSᵀu, of shape (n,): the actuated joints' efforts seen by the independent coordinates."""
        effort = self.checked(u, "u", self.n_actuated)
        return effort if self._direct else np.asarray(point.rho.T @ (self._actuation.T @ effort))

    def joint_efforts(self, q_free: ArrayLike, u: ArrayLike) -> Array:
        """Sᵀu, of shape (n′,): what the motors do to the free system's joints (α_q′ᵀu where u acts on q itself)."""
        effort = self.checked(u, "u", self.n_actuated)
        if self._direct:
            return np.asarray(self.coordinates.jacobian(self.checked_configuration(q_free)).T @ effort)
        return np.asarray(self._actuation.T @ effort)

    def forward_dynamics(self, q: ArrayLike, v: ArrayLike, u: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """q̈ = D⁻¹(ρᵀSᵀu − C q̇ − g) (22), of shape (n,).

        Raises:
            UnsupportedMechanismError: D is not positive definite (bodies without mass or inertia).
        """
        point = self.closed_point(q, guess)
        return self.acceleration(point, self.checked(v, "v", self.n), u)

    def acceleration(self, point: ClosedPoint, v: Array, u: ArrayLike) -> Array:
        """Forward dynamics at a configuration already closed."""
        v_free = point.rho @ v
        bias = self.free_system.inverse_dynamics(point.q_free, v_free, self.parametrization.bias(point, v_free))
        mass = point.rho.T @ (self.free_system.mass_matrix(point.q_free) @ point.rho)
        force = self.generalized_force(point, u) - point.rho.T @ bias
        if not self.n:
            return np.zeros(0)
        _, a, info = lapack.dposv(mass, force)
        if info != 0 and point.factor.rcond < 1e-6:
            raise SingularConfigurationError(
                f"the reduced dynamics break down near a singularity (reciprocal condition number of ψ_q′ "
                f"{point.factor.rcond:.1e})",
                q_free=point.q_free,
                rcond=point.factor.rcond,
            )
        if info != 0:
            raise UnsupportedMechanismError(
                "the reduced mass matrix D is not positive definite: some independent motion moves no mass; give the "
                "links inertias, or lock that motion"
            )
        return np.asarray(a)

    def inverse_dynamics(self, q: ArrayLike, v: ArrayLike, a: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """The actuated joints' efforts u with ρᵀSᵀu = D q̈ + C q̇ + g (22), of shape (motors,).

        With more motors than independent coordinates u is the solution of least norm.

        Raises:
            UnderactuatedError: No u produces that acceleration (fewer motors than coordinates).
        """
        point = self.closed_point(q, guess)
        v_free = point.rho @ self.checked(v, "v", self.n)
        a_free = point.rho @ self.checked(a, "a", self.n) + self.parametrization.bias(point, v_free)
        force = point.rho.T @ self.free_system.inverse_dynamics(point.q_free, v_free, a_free)
        if self._direct:
            return np.asarray(force)
        transmission = point.rho.T @ self._actuation.T
        u = np.linalg.lstsq(transmission, force, rcond=None)[0]
        missing = float(np.abs(transmission @ u - force).max())
        if missing > 1e-9 * max(1.0, float(np.abs(force).max())):
            raise UnderactuatedError(
                f"{self.n_actuated} motors cannot produce this acceleration: "
                f"a generalized force of {missing:.3g} is left"
            )
        return np.asarray(u)

    def forward_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, guess: ArrayLike | None = None
    ) -> ForwardDynamicsDerivatives:
        """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂u, exact; ∂q along tangent steps of q. Errors as for `forward_dynamics`."""
        point, velocity = self.closed_point(q, guess), self.checked(v, "v", self.n)
        effort, a = self.checked(u, "u", self.n_actuated), self.acceleration(point, velocity, u)
        return self._derivatives(point).forward(velocity, effort, a)

    def inverse_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, guess: ArrayLike | None = None
    ) -> InverseDynamicsDerivatives:
        """∂u/∂q, ∂u/∂q̇ and ∂u/∂q̈ of the actuated joints' efforts, exact; errors as for `inverse_dynamics`."""
        point = self.closed_point(q, guess)
        u = self.inverse_dynamics(q, v, a, point.q_free)
        velocity, acceleration = self.checked(v, "v", self.n), self.checked(a, "a", self.n)
        return self._derivatives(point).inverse(velocity, u, acceleration)

    def generalized_force_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, guess: ArrayLike | None = None
    ) -> GeneralizedForceDerivatives:
        """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of τ = D q̈ + C q̇ + g, exact, whatever the motors; errors as for `sigma`."""
        point = self.closed_point(q, guess)
        return self._derivatives(point).generalized_force(self.checked(v, "v", self.n), self.checked(a, "a", self.n))

    def gravity_derivative(self, q: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """∂g/∂q, of shape (n, n), along tangent steps of q: the potential's Hessian for plain coordinates."""
        return self._derivatives(self.closed_point(q, guess)).gravity()

    def _derivatives(self, point: ClosedPoint) -> DynamicsDerivatives:
        actuation = None if self._direct else self._actuation
        return DynamicsDerivatives(self.free_system, self.parametrization, point, actuation)

    def constraint_forces(self, q: ArrayLike, v: ArrayLike, u: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """λ of the descriptor form (17): D′q̈′ + C′q̇′ + g′ = Sᵀu + φ_q′ᵀλ, of shape (m,).

        λ has one entry a row of φ, in φ's order and axes (`ccpin.kinematics.constraints`): the force (N) that end A of
        a loop receives along a point row, B the opposite; the moment (N m) along a direction row. With redundant rows
        λ is the solution of least norm.
        """
        point = self.closed_point(q, guess)
        velocity = self.checked(v, "v", self.n)
        v_free = point.rho @ velocity
        a = self.acceleration(point, velocity, u)
        a_free = point.rho @ a + self.parametrization.bias(point, v_free)
        dynamics = self.free_system.inverse_dynamics(point.q_free, v_free, a_free)
        force = dynamics - self.joint_efforts(point.q_free, u)
        return point.factor.solve_transposed(force)[: self.parametrization.constraints.size]

    def energy(self, q: ArrayLike, v: ArrayLike, guess: ArrayLike | None = None) -> Energy:
        """Kinetic energy ½ q̇ᵀD q̇ and potential energy V with ∂V/∂q = g, in joules."""
        point = self.closed_point(q, guess)
        return self.free_system.energy(point.q_free, point.rho @ self.checked(v, "v", self.n))

    def sigma_many(self, Q: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """σ of each row of Q (N, nq_independent), of shape (N, nq); each row as if asked for alone."""
        rows = self._rows(Q, "Q", self.nq)
        return np.array([self.sigma(q, guess) for q in rows]).reshape(len(rows), self.mechanism.nq)

    def terms_many(self, Q: ArrayLike, V: ArrayLike, guess: ArrayLike | None = None) -> ReducedTerms:
        """`terms` of each row of Q and V; every field has a leading axis of length N."""
        rows, velocities = self._rows(Q, "Q", self.nq), self._rows(V, "V", self.n)
        self._same_length(rows, velocities)
        each = [self.terms(q, v, guess) for q, v in zip(rows, velocities, strict=True)]
        if not each:
            n_free, n = self.mechanism.n_free, self.n
            shapes = ((self.mechanism.nq,), (n_free,), (n_free, n), (n_free, n), (n, n), (n, n), (n,))
            return ReducedTerms(*(np.empty((0, *shape)) for shape in shapes))
        return ReducedTerms(*(np.array(field) for field in zip(*each, strict=True)))

    def forward_dynamics_many(self, Q: ArrayLike, V: ArrayLike, U: ArrayLike, guess: ArrayLike | None = None) -> Array:
        """`forward_dynamics` of each row of Q, V and U, of shape (N, n)."""
        rows, velocities, efforts = self._rows(Q, "Q", self.nq), self._rows(V, "V", self.n), self._rows(U, "U", None)
        self._same_length(rows, velocities, efforts)
        each = [self.forward_dynamics(q, v, u, guess) for q, v, u in zip(rows, velocities, efforts, strict=True)]
        return np.array(each).reshape(len(rows), self.n)

    def checked_q(self, q: ArrayLike) -> Array:
        """Return q as a float64 vector on its manifold.

        Raises:
            InvalidInputError: Wrong shape, not finite, or a circle or quaternion that is not of unit length.
        """
        array = self.checked(q, "q", self.nq)
        if not self.coordinates.scalar:
            if self.coordinates.off_manifold(array) > 1e-6:
                raise InvalidInputError("q holds a quaternion or (cosine, sine) pair that is not of unit length")
            array = self.coordinates.normalize(array)
        return array

    def checked_configuration(self, q_free: ArrayLike, name: str = "q_free") -> Array:
        """Return a configuration q′ as a float64 vector.

        Raises:
            InvalidInputError: Wrong shape, not finite, or a circle or quaternion that is not of unit length.
        """
        array = self.checked(q_free, name, self.mechanism.nq)
        if not self.free_system.on_manifold(array):
            raise InvalidInputError(f"{name} holds a quaternion or (cosine, sine) pair that is not of unit length")
        return array

    def checked(self, value: ArrayLike, name: str, size: int) -> Array:
        """Return a finite float64 vector of the given size.

        Raises:
            InvalidInputError: It is not that.
        """
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise InvalidInputError(f"{name} is not an array of numbers") from None
        if array.shape != (size,):
            raise InvalidInputError(f"{name} has shape {array.shape}; it must be ({size},)")
        if not np.isfinite(array).all():
            raise InvalidInputError(f"{name} has entries that are not finite")
        return array

    def _rows(self, value: ArrayLike, name: str, size: int | None) -> Array:
        try:
            array = np.asarray(value, dtype=np.float64)
        except (TypeError, ValueError):
            raise InvalidInputError(f"{name} is not a rectangular array of numbers") from None
        if array.ndim != 2 or (size is not None and array.shape[1] != size):
            raise InvalidInputError(f"{name} has shape {array.shape}; it must be (N, {size or self.n_actuated})")
        return array

    def _same_length(self, *arrays: Array) -> None:
        if len({len(array) for array in arrays}) != 1:
            raise InvalidInputError(f"arrays of different lengths: {', '.join(str(len(a)) for a in arrays)}")
