"""The reduced model of a closed-chain mechanism: D q̈ + C q̇ + g = u in the independent coordinates (Theorem 1).

What the paper has no letter for comes beside it: springs are part of V and so of g = ∂V/∂q, joints' dampers add
ρᵀB′ρ q̇ on the left, wrenches on links ρᵀJᵀw on the right, and gears scale the rows of S.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from ccpin.arrays import Array, frozen, instance, vector, whole
from ccpin.displays import table
from ccpin.dynamics.batches import Failures, Rows, completed, rows, together
from ccpin.dynamics.derivatives import (
    ForwardDynamicsDerivatives,
    GeneralizedForceDerivatives,
    InverseDynamicsDerivatives,
)
from ccpin.dynamics.free_system import Energy, FreeSystem
from ccpin.dynamics.parameters import DynamicParameters, dynamic_parameters
from ccpin.dynamics.reference_backend import ReferenceBackend
from ccpin.dynamics.state import Near, ReducedTerms, State
from ccpin.dynamics.wrenches import Wrenches, wrench_rows
from ccpin.errors import InvalidInputError
from ccpin.kinematics.coordinates import IndependentCoordinates, checked_configuration, checked_q
from ccpin.kinematics.parametrization import ClosedPoint
from ccpin.mechanism.mechanism import Mechanism, mechanism_of
from ccpin.native import Backend, Declining, backend, core_of
from ccpin.proof.digests import Digests, digest


class Reading(NamedTuple):
    """Independent coordinates q, of shape (model.nq,), and velocities q̇, of shape (n,)."""

    q: Array
    v: Array


class ReducedModel:
    """The reduced equations D q̈ + C q̇ + damping q̇ + g = ρᵀ(Sᵀu + Jᵀw) (22), q′ = σ(q), q̇′ = ρ q̇ (27).

    Where the actuated joints are the independent ones, without gears, ρᵀSᵀu = u as in the paper. `at` gives a `State`,
    which has all the rest; the methods below with a `near` are shorthands for it, for one thing at one q. Nothing is
    remembered between calls, and any number of threads may share a model. SI units, radians.

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
        core: What answers first (`ccpin.native`), chosen by `ccpin.backend` when the model was made.

    Raises:
        InvalidInputError: No mechanism is given, or gravity is not three finite numbers.
    """

    def __init__(self, mechanism: Mechanism, gravity: ArrayLike | None = None) -> None:
        self.mechanism = mechanism = mechanism_of(mechanism)
        given = mechanism.description.gravity if gravity is None else vector(gravity, "gravity", 3)
        self.gravity_vector = frozen(given)
        self.free_system = FreeSystem(mechanism.tree, self.gravity_vector)
        self.parametrization = mechanism.parametrization()
        self.coordinates = self.parametrization.coordinates
        self.n = self.coordinates.n
        self.nq = self.coordinates.nq
        self.actuation = None if mechanism.direct else frozen(mechanism.actuation)
        self.n_actuated = self.n if self.actuation is None else len(self.actuation)
        self.core = core_of(mechanism, self.gravity_vector)

    def __reduce__(self) -> tuple[type[ReducedModel], tuple[Mechanism, Array]]:
        return ReducedModel, (self.mechanism, self.gravity_vector)

    def __repr__(self) -> str:
        return f"ReducedModel({self.mechanism!r})"

    def _repr_html_(self) -> str:
        """A small table for notebooks: what q and u are, and the reduced model at the reference."""
        mechanism, there = self.mechanism, self.at(self.alpha(self.mechanism.q_reference))
        numbers = {"q": there.q, "D": there.D, "g": there.g}
        return table(
            [
                (
                    "reduced model of",
                    f"{mechanism.name}: D q̈ + C q̇ + g = u (22), n = {self.n} of n′ = {mechanism.n_free}",
                ),
                ("q", ", ".join(mechanism.independent)),
                ("u", ", ".join(mechanism.actuated)),
                *((f"{name} at the reference", np.array2string(x, precision=4)) for name, x in numbers.items()),
                ("1/κ(ψ) there", f"{there.rcond:.3g}"),
            ]
        )

    @property
    def backend(self) -> Backend:
        """What computes for this model, and why (`ccpin.native`)."""
        if isinstance(self.core, Declining):
            return Backend("numpy", self.core.reason)
        return backend()

    @cached_property
    def parameters(self) -> DynamicParameters:
        """π: the constants in which the equations of motion are linear, with their values (`State.regressor`)."""
        return dynamic_parameters(self.mechanism.tree)

    @cached_property
    def digests(self) -> Digests:
        """What it is about: its mechanism's digests, gravity among the dynamics (`ccpin.proof.digests`)."""
        own = self.mechanism.digests
        return own._replace(dynamics=digest((own.dynamics, self.gravity_vector)))

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
            return q if q.model is self else State.of(self, q.q, self._own(q).point)
        wanted = frozen(checked_q(self.coordinates, q))
        answer = self.core.closed_point(self._place(near), wanted)
        if answer is not None:
            return State(self, wanted, ReferenceBackend(self, *answer))
        blocked = self.core.blocked(self._place(near), wanted)
        if blocked is not None:
            start = self.mechanism.q_reference if near is None else self._place(near)
            raise self.parametrization.blocked(np.asarray(start, dtype=np.float64), wanted, *blocked)
        return State.of(self, wanted, self.parametrization.sigma(wanted, self._start(near)))

    def alpha(self, q_free: ArrayLike) -> Array:
        """q = α(q′) (7), of shape (model.nq,)."""
        return self.coordinates.alpha(self._configuration(q_free))

    def reading(self, state: State, v: Array) -> Reading:
        """q = α(q′) and q̇ = α_q′ q̇′ of this model at a State of it, or of its mechanism in other coordinates.

        Args:
            state: The State, of this model or of a sibling (`ccpin.mechanism.other_coordinates.independent_sets`).
            v: The State's own independent velocities.

        Raises:
            InvalidInputError: It is no State.
        """
        if instance(state, "state", State).model is self:
            return Reading(state.q, v)
        rate = self.coordinates.jacobian(state.q_free) @ state.v_free(v)
        return Reading(self.coordinates.alpha(state.q_free), rate)

    def reading_rate(self, state: State, v: Array, a: Array) -> Array:
        """q̈ = α_q′ q̈′ + α̇_q′ q̇′ of this model where `reading` gives q and q̇, from the State's own v and a."""
        if instance(state, "state", State).model is self:
            return a
        v_free, q_free = state.v_free(v), state.q_free
        rate = self.coordinates.jacobian_rate(q_free, v_free)
        own = self.coordinates.jacobian(q_free) @ state.a_free(v, a)
        return np.asarray(own if rate is None else own + rate @ v_free)

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

    def sigma(self, q: ArrayLike, near: Near = None, *, proved: bool = False) -> Array:
        """q′ = σ(q) (12), of shape (nq,), on the branch of `near`: a copy of `State.q_free`.

        With `proved` no step on the way rests on an estimate (`ccpin.kinematics.continuation`): the answer is what
        `near` is continued to, and no singular configuration lies between. It takes milliseconds.
        """
        if proved:
            wanted, start = checked_q(self.coordinates, q), self._start(near)
            return self.parametrization.sigma(wanted, start, proved=True).q_free.copy()
        answer = self.core.sigma(q, self._place(near))
        return self.at(q, near).q_free.copy() if answer is None else np.asarray(answer)

    def terms(self, q: ArrayLike, v: ArrayLike, near: Near = None) -> ReducedTerms:
        """D, C, g (23)–(25) and what they come from: `State.terms`."""
        answer = self._asked("terms", q, near, v)
        return self.at(q, near).terms(v) if answer is None else ReducedTerms(*answer)

    def gravity(self, q: ArrayLike, near: Near = None) -> Array:
        """g(q) = ρᵀg′(σ(q)) (25), of shape (n,): `State.g`."""
        answer = self._asked("gravity", q, near)
        return self.at(q, near).g if answer is None else np.asarray(answer)

    def gravity_derivative(self, q: ArrayLike, near: Near = None) -> Array:
        """∂g/∂q, of shape (n, n): `State.gravity_derivative`."""
        return self.at(q, near).gravity_derivative

    def energy(self, q: ArrayLike, v: ArrayLike, near: Near = None) -> Energy:
        """½ q̇ᵀD q̇ and V, in joules: `State.energy`."""
        answer = self._asked("energy", q, near, v)
        return self.at(q, near).energy(v) if answer is None else Energy(*answer)

    def forward_dynamics(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, near: Near = None, wrenches: Wrenches | None = None
    ) -> Array:
        """q̈ (22), of shape (n,): `State.forward_dynamics`."""
        answer = self._asked("forward_dynamics", q, near, v, u, wrenches=wrenches)
        return self.at(q, near).forward_dynamics(v, u, wrenches) if answer is None else np.asarray(answer)

    def inverse_dynamics(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, near: Near = None, wrenches: Wrenches | None = None
    ) -> Array:
        """u with ρᵀSᵀu = τ (22), of shape (motors,): `State.inverse_dynamics`."""
        return self.at(q, near).inverse_dynamics(v, a, wrenches)

    def constraint_forces(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, near: Near = None, wrenches: Wrenches | None = None
    ) -> Array:
        """λ of the descriptor form (17), of shape (m,): `State.constraint_forces`."""
        answer = self._asked("constraint_forces", q, near, v, u, wrenches=wrenches)
        return self.at(q, near).constraint_forces(v, u, wrenches) if answer is None else np.asarray(answer)

    def forward_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, u: ArrayLike, near: Near = None, wrenches: Wrenches | None = None
    ) -> ForwardDynamicsDerivatives:
        """∂q̈/∂q, ∂q̈/∂q̇ and ∂q̈/∂u: `State.forward_dynamics_derivatives`."""
        answer = self._asked("forward_dynamics_derivatives", q, near, v, u, wrenches=wrenches)
        if answer is None:
            return self.at(q, near).forward_dynamics_derivatives(v, u, wrenches)
        return ForwardDynamicsDerivatives(*answer)

    def inverse_dynamics_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, near: Near = None, wrenches: Wrenches | None = None
    ) -> InverseDynamicsDerivatives:
        """∂u/∂q, ∂u/∂q̇ and ∂u/∂q̈: `State.inverse_dynamics_derivatives`."""
        return self.at(q, near).inverse_dynamics_derivatives(v, a, wrenches)

    def generalized_force_derivatives(
        self, q: ArrayLike, v: ArrayLike, a: ArrayLike, near: Near = None, wrenches: Wrenches | None = None
    ) -> GeneralizedForceDerivatives:
        """∂τ/∂q, ∂τ/∂q̇ and ∂τ/∂q̈ of τ: `State.generalized_force_derivatives`."""
        answer = self._asked("generalized_force_derivatives", q, near, v, a, wrenches=wrenches)
        if answer is None:
            return self.at(q, near).generalized_force_derivatives(v, a, wrenches)
        return GeneralizedForceDerivatives(*answer)

    # Many rows at once, each as if asked for alone, on as many `threads` of the compiled core. Where a row has no
    # answer its error is raised, or, where a dictionary is given for `failures`, the row is NaN and its reason there.

    def sigma_many(self, Q: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None) -> Array:
        """σ of each row of Q (N, model.nq), of shape (N, nq)."""
        return self._many("sigma", [rows(Q, "Q", self.nq)], near, threads, [(self.mechanism.nq,)], failures)[0]

    def terms_many(
        self, Q: Rows, V: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> ReducedTerms:
        """`terms` of each row of Q and V; every field has a leading axis of length N."""
        n_free, n = self.mechanism.n_free, self.n
        shapes = (self.mechanism.nq,), (n_free,), (n_free, n), (n_free, n), (n, n), (n, n), (n,)
        given = [rows(Q, "Q", self.nq), rows(V, "V", n)]
        return ReducedTerms(*self._many("terms", given, near, threads, shapes, failures))

    def forward_dynamics_many(
        self, Q: Rows, V: Rows, U: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> Array:
        """`forward_dynamics` of each row of Q, V and U, of shape (N, n)."""
        given = [rows(Q, "Q", self.nq), rows(V, "V", self.n), rows(U, "U", self.n_actuated)]
        return self._many("forward_dynamics", given, near, threads, [(self.n,)], failures)[0]

    def inverse_dynamics_many(
        self, Q: Rows, V: Rows, A: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> Array:
        """`inverse_dynamics` of each row of Q, V and A, of shape (N, motors)."""
        given = [rows(Q, "Q", self.nq), rows(V, "V", self.n), rows(A, "A", self.n)]
        return self._many("inverse_dynamics", given, near, threads, [(self.n_actuated,)], failures)[0]

    def forward_dynamics_derivatives_many(
        self, Q: Rows, V: Rows, U: Rows, near: Near = None, *, threads: int = 1, failures: Failures | None = None
    ) -> ForwardDynamicsDerivatives:
        """`forward_dynamics_derivatives` of each row of Q, V and U; every field has a leading axis of length N."""
        given = [rows(Q, "Q", self.nq), rows(V, "V", self.n), rows(U, "U", self.n_actuated)]
        shapes = (self.n, self.n), (self.n, self.n), (self.n, self.n_actuated)
        found = self._many("forward_dynamics_derivatives", given, near, threads, shapes, failures)
        return ForwardDynamicsDerivatives(*found)

    def regressor_many(
        self,
        Q: Rows,
        V: Rows,
        A: Rows,
        near: Near = None,
        *,
        V_r: Rows | None = None,
        threads: int = 1,
        failures: Failures | None = None,
    ) -> Array:
        """`State.regressor` of each row of Q, V, A and V_r (default V), of shape (N, n, p)."""
        v = rows(V, "V", self.n)
        given = [rows(Q, "Q", self.nq), v, rows(A, "A", self.n), v if V_r is None else rows(V_r, "V_r", self.n)]

        def alone(row: int) -> tuple[Array]:
            q, *rates = (array[row] for array in given)
            return (self.at(q, near).regressor(*rates),)

        shape = self.n, len(self.parameters)
        return self._many("regressor", given, near, threads, [shape], failures, alone)[0]

    def _many(
        self,
        name: str,
        given: list[Array],
        near: Near,
        threads: int,
        shapes: Sequence[tuple[int, ...]],
        failures: Failures | None,
        alone: Callable[[int], Sequence[Array]] | None = None,
    ) -> list[Array]:
        """Each row of the arguments given to the shorthand of that name, or to `alone`, field by field."""
        count = together(*given)
        found = getattr(self.core, f"{name}_many")(*given, self._place(near), whole(threads, "threads"))
        if found is not None:
            finite = np.logical_and.reduce([np.isfinite(array).all(axis=1) for array in given])
            found = ((found[0],) if len(shapes) == 1 else found[0]), found[1] & finite

        def shorthand(row: int) -> Sequence[Array]:
            answer = getattr(self, name)(*(array[row] for array in given), near)
            return (answer,) if len(shapes) == 1 else answer

        return completed(found, alone or shorthand, count, shapes, failures)

    def _configuration(self, q_free: ArrayLike, name: str = "q_free") -> Array:
        return checked_configuration(self.free_system.model, q_free, name)

    def _start(self, near: Near) -> Array | ClosedPoint | None:
        if isinstance(near, State):
            return self._own(near).point
        return None if near is None else self._configuration(near, "near")

    def _asked(
        self, name: str, q: ArrayLike | State, near: Near, *arguments: ArrayLike, wrenches: Wrenches | None = None
    ) -> Any:
        """The core's answer at σ(q); without q it would answer at `near` itself."""
        if q is None:
            return None
        ask, near = getattr(self.core, name), self._place(near)
        if wrenches is None:
            return ask(near, *arguments, q)
        return ask(near, *arguments, q, wrench_rows(self.mechanism.tree, wrenches))

    def _place(self, near: Near) -> ArrayLike | None:
        """What the core is given for a branch."""
        return self._own(near).q_free if isinstance(near, State) else near

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
    return mechanism_of(subject).parametrization().coordinates
