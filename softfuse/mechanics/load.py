"""What acts on a body: loads that push at ports, and the laws that say how hard.

A port is a scalar y(z) of the configuration with a conjugate force f, which enters the balance as r(z) = Σ f
∂y/∂z. The laws of all loads together are a few equations E(x, y, u) = 0 for as many unknowns x = (f, w):
forces of those ports that carry one, and internal unknowns such as the depth of a punch or the tension of a
cable; u are the *drives*, what somebody prescribes: a total force, a shortening, an amount of gas. The body
itself is seen only through its compliance between ports, so everything non-smooth or nonlinear in a load
lives in a dense problem of some tens of unknowns (`interface`), and no law needs a penalty.
"""

from abc import abstractmethod

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float

from softfuse.body.base import AbstractBody
from softfuse.errors import SolveError
from softfuse.functional.contact import Contact


class AbstractPorts(eqx.Module):
    """p scalars y(z) of a body's unknowns z (n,)."""

    @abstractmethod
    def values(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, " p"]:
        """y (p,) in SI units."""

    @abstractmethod
    def rows(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, "n p"]:
        """∂y/∂z (n, p): generalised nodal forces per unit of each port's force."""

    @abstractmethod
    def stiffen(
        self,
        body: AbstractBody,
        z: Float[Array, " n"],
        force: Float[Array, " q"],
        tangents: Float[Array, "e d d"],
    ) -> Float[Array, "e d d"]:
        """The element tangents (e, d, d) minus Σ f ∂²y/∂z², f (q,) the forces of the first q ports, plus the
        springs that support the ports.
        """

    @property
    @abstractmethod
    def supports(self) -> Float[Array, " p"]:
        """Stiffness (p,) of springs that support the ports while the body is linearised, 0 for none: see
        `HeldLoads`.
        """

    @abstractmethod
    def resultants(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, "6 p"]:
        """Force [N], then moment about the origin [Nm], on the whole body, held nodes included, per unit of
        each port's force: ∂y/∂(motion) for rigid motions of the body's current shape.
        """


class AbstractLinearPorts(AbstractPorts):
    """y = y₀ + Gᵀz: values at rest y₀ (p,) and rows G (n, p)."""

    rest: eqx.AbstractVar[Float[Array, " p"]]
    slopes: eqx.AbstractVar[Float[Array, "n p"]]

    def values(self, body, z):
        """y₀ + Gᵀ z (p,)."""
        del body
        return self.rest + self.slopes.T @ z

    def rows(self, body, z):
        """G (n, p)."""
        del body, z
        return self.slopes

    def stiffen(self, body, z, force, tangents):
        """The tangents as they are: linear ports have no second derivative."""
        del body, z, force
        return tangents

    @property
    def supports(self):
        """No springs."""
        return jnp.zeros_like(self.rest)


class LinearPorts(AbstractLinearPorts):
    """Nothing but values at rest (p,) and rows (n, p)."""

    rest: Float[Array, " p"]
    slopes: Float[Array, "n p"]

    def resultants(self, body, z):
        """Raises SolveError: rows alone do not tell what acts on held nodes."""
        raise SolveError("where forces on linear ports act is not known: use ports of points or of a contact")


def force_resultants(at: Float[Array, "g 3"]) -> Float[Array, "6 3*g"]:
    """Resultants, see `AbstractPorts`, of unit forces along x, y, z at points (g, 3) m."""
    forces = jnp.tile(jnp.eye(3), (len(at), 1))
    return jnp.concatenate([forces, jnp.cross(jnp.repeat(at, 3, axis=0), forces)], axis=1).T


class AbstractLoad(eqx.Module):
    """Ports, and the law of the forces f (q,) on the first q of them, with internal unknowns w (m,) and
    drives u (k,).
    """

    ports: eqx.AbstractVar[AbstractPorts]

    @property
    @abstractmethod
    def sizes(self) -> "Sizes":
        """Numbers of ports p, forces q, internal unknowns m, drives k."""

    @abstractmethod
    def start(self) -> tuple[Float[Array, " q"], Float[Array, " m"], Float[Array, " k"]]:
        """Forces, internal unknowns and drives of the body at rest."""

    @abstractmethod
    def units(self) -> Float[Array, " qm"]:
        """Typical sizes (q + m,) of forces and internal unknowns, in SI units."""

    @abstractmethod
    def equations(
        self,
        force: Float[Array, " q"],
        internal: Float[Array, " m"],
        y: Float[Array, " p"],
        drive: Float[Array, " k"],
    ) -> Float[Array, " qm"]:
        """E (q + m,), all 0 where the law holds."""

    def equations_near(
        self,
        force: Float[Array, " q"],
        internal: Float[Array, " m"],
        y: Float[Array, " p"],
        drive: Float[Array, " k"],
        at: tuple[Float[Array, " m"], Float[Array, " p"]],
    ) -> Float[Array, " qm"]:
        """E (q + m,) to first order around internal unknowns and ports' values `at`, branches excepted, for
        laws that may have no solution on a body linearised far from its equilibrium; others are as they are.
        """
        del at
        return self.equations(force, internal, y, drive)

    @abstractmethod
    def conjugate(
        self, force: Float[Array, " q"], internal: Float[Array, " m"], y: Float[Array, " p"]
    ) -> Float[Array, " k"]:
        """What answers each drive (k,): the stroke of a force, the force of a prescribed displacement."""

    def by_answer(self, body: AbstractBody) -> "AbstractLoad":
        """The same load on a body at rest, driven by what answers it: a cable by its shortening. Raises
        SolveError for one that cannot be driven so.
        """
        del body
        raise SolveError(f"{type(self).__name__} is not driven by what answers it")

    def by_force(
        self, internal: Float[Array, " m"], drive: Float[Array, " k"]
    ) -> tuple[Float[Array, " w"], Float[Array, " k"]]:
        """Internal unknowns (w,) and drives (k,), in the same state, of the load that this is `by_answer`; as
        they are where it is none.
        """
        return internal, drive


class AbstractContact(eqx.Module):
    """What may touch a body, and how it presses: a load for every place (3, 3), see `functional.chart`."""

    @property
    @abstractmethod
    def arms(self) -> Float[Array, " c"]:
        """How far from the place along its first tangent each of the forces acts that one contact is driven
        with (c,) [m].
        """

    @property
    def drives(self) -> int:
        """How many forces [N] one contact is driven with."""
        return self.arms.shape[0]

    @property
    def shares(self) -> Float[np.ndarray, " c"]:
        """How its force [N] along the normal is shared among those that it is driven with (c,) [-]."""
        return np.full(self.drives, 1.0 / self.drives)

    @abstractmethod
    def load(self, body: AbstractBody, place: Float[Array, "3 3"]) -> AbstractLoad:
        """The load of one contact at a place; its drives are the forces [N]."""

    def discs(self, body: AbstractBody, place: Float[Array, "3 3"]) -> list[Contact]:
        """The discs of the surface through which it presses at a place, none where all is known to lie on
        it.
        """
        del body, place
        return []

    def overlap(self, body: AbstractBody, place: Float[Array, "3 3"]) -> Float[Array, ""]:
        """What part [-] of each disc of a contact at a place lies on the surface, the least of them: 1 unless
        one overhangs an edge.
        """
        return jnp.min(jnp.stack([jnp.ones(()), *(disc.overlap(body) for disc in self.discs(body, place))]))

    def lands(self, body: AbstractBody, place: Float[Array, "3 3"]) -> Bool[Array, ""]:
        """Whether the middle of each disc at a place is no further than its radius from where its direction
        enters the body at rest.
        """
        landed = [jnp.array(True)]
        for disc in self.discs(body, place):
            on = disc.surface.land(body.rest, disc.location[None])
            apart = jnp.linalg.norm(on.shape[0] @ body.rest[on.nodes[0]] - disc.location)
            landed.append(on.met[0] & (apart <= disc.radius))
        return jnp.all(jnp.stack(landed))

    def stands(self, body: AbstractBody, place: Float[Array, "3 3"]) -> Bool[Array, ""]:
        """Whether it may press at a place: some of each disc lies on the surface."""
        return self.overlap(body, place) > 0

    def at_depth(self) -> "AbstractContact | None":
        """The same, driven by its depth [m] from where it first touches the body at rest, and answered by its
        force [N]; None of what is not rigid.
        """
        return None

    def recut(self, rims: tuple[float, ...], sectors: tuple[int, ...]) -> "AbstractContact":
        """The same contact, with cells between these rims where its pressure is told by several, see
        `functional.pressure_cells`.
        """
        del rims, sectors
        return self


class Sizes(eqx.Module):
    """Numbers of ports, of forces on the first of them, of internal unknowns and of drives."""

    ports: int = eqx.field(static=True)
    forces: int = eqx.field(static=True)
    internal: int = eqx.field(static=True)
    drives: int = eqx.field(static=True)


def _cut(counts: list[int], vector: Array) -> list[Array]:
    return jnp.split(vector, np.cumsum(counts, dtype=int)[:-1])[: len(counts)]


def _joined(parts: list[Array]) -> Array:
    return jnp.concatenate([jnp.zeros(0), *parts])


class Loads(eqx.Module):
    """All loads on a body, their ports, forces, internal unknowns and drives one after the other."""

    parts: tuple[AbstractLoad, ...]

    @property
    def sizes(self) -> Sizes:
        """Total numbers."""
        each = [part.sizes for part in self.parts]
        return Sizes(
            sum(s.ports for s in each),
            sum(s.forces for s in each),
            sum(s.internal for s in each),
            sum(s.drives for s in each),
        )

    @property
    def carrying(self) -> np.ndarray:
        """The ports (Q,) that carry a force."""
        first, found = 0, []
        for part in self.parts:
            found.append(first + np.arange(part.sizes.forces))
            first += part.sizes.ports
        return np.concatenate([np.zeros(0, int), *found])

    def start(self) -> tuple[Float[Array, " Q"], Float[Array, " M"], Float[Array, " D"]]:
        """Forces, internal unknowns and drives of the body at rest."""
        each = [part.start() for part in self.parts]
        force, internal, drive = (_joined([one[kind] for one in each]) for kind in range(3))
        return force, internal, drive

    def units(self) -> Float[Array, " QM"]:
        """Typical sizes (Q + M,) of forces, then internal unknowns."""
        each = [part.units() for part in self.parts]
        forces = [u[: part.sizes.forces] for u, part in zip(each, self.parts, strict=True)]
        internal = [u[part.sizes.forces :] for u, part in zip(each, self.parts, strict=True)]
        return _joined([*forces, *internal])

    def values(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, " P"]:
        """All ports' values (P,)."""
        return _joined([part.ports.values(body, z) for part in self.parts])

    def rows(self, body: AbstractBody, z: Float[Array, " n"]) -> Float[Array, "n P"]:
        """All ports' rows (n, P)."""
        each = [part.ports.rows(body, z) for part in self.parts]
        return jnp.concatenate([jnp.zeros((body.n, 0)), *each], axis=1)

    def push(
        self, body: AbstractBody, z: Float[Array, " n"], force: Float[Array, " Q"]
    ) -> Float[Array, " n"]:
        """Generalised nodal forces (n,) of the forces (Q,)."""
        return jax.vjp(lambda x: self.values(body, x)[self.carrying], z)[1](force)[0]

    @property
    def supports(self) -> Float[Array, " Q"]:
        """Stiffness (Q,) of the springs that support those ports which carry a force."""
        return _joined([part.ports.supports for part in self.parts])[self.carrying]

    def stiffen(
        self,
        body: AbstractBody,
        z: Float[Array, " n"],
        force: Float[Array, " Q"],
        tangents: Float[Array, "e d d"],
    ) -> Float[Array, "e d d"]:
        """Element tangents (e, d, d) with what the forces (Q,) add."""
        counts = [part.sizes.forces for part in self.parts]
        for part, f in zip(self.parts, _cut(counts, force), strict=True):
            tangents = part.ports.stiffen(body, z, f, tangents)
        return tangents

    def equations(
        self,
        force: Float[Array, " Q"],
        internal: Float[Array, " M"],
        y: Float[Array, " P"],
        drive: Float[Array, " D"],
    ) -> Float[Array, " QM"]:
        """The laws of all loads (Q + M,): those of the first load, then of the second ..."""
        drives = _cut([part.sizes.drives for part in self.parts], drive)
        own = zip(self.parts, self._own(force, internal, y), drives, strict=True)
        return _joined([part.equations(*at, given) for part, at, given in own])

    def equations_near(
        self,
        force: Float[Array, " Q"],
        internal: Float[Array, " M"],
        y: Float[Array, " P"],
        drive: Float[Array, " D"],
        at: tuple[Float[Array, " M"], Float[Array, " P"]],
    ) -> Float[Array, " QM"]:
        """The laws of all loads (Q + M,) to first order, see `AbstractLoad.equations_near`."""
        drives = _cut([part.sizes.drives for part in self.parts], drive)
        own, near = self._own(force, internal, y), self._own(force, *at)
        each = zip(self.parts, own, drives, near, strict=True)
        return _joined([part.equations_near(*now, given, around[1:]) for part, now, given, around in each])

    def conjugate(
        self, force: Float[Array, " Q"], internal: Float[Array, " M"], y: Float[Array, " P"]
    ) -> Float[Array, " D"]:
        """What answers each drive (D,)."""
        own = zip(self.parts, self._own(force, internal, y), strict=True)
        return _joined([part.conjugate(*at) for part, at in own])

    def by_force(
        self, internal: Float[Array, " M"], drive: Float[Array, " D"]
    ) -> tuple[Float[Array, " W"], Float[Array, " D"]]:
        """Internal unknowns (W,) and drives (D,) of all loads, see `AbstractLoad.by_force`."""
        sizes = [part.sizes for part in self.parts]
        cut = _cut([s.internal for s in sizes], internal), _cut([s.drives for s in sizes], drive)
        each = [part.by_force(*own) for part, *own in zip(self.parts, *cut, strict=True)]
        return _joined([internal for internal, _ in each]), _joined([drive for _, drive in each])

    def _own(self, force: Array, internal: Array, y: Array) -> list[tuple[Array, Array, Array]]:
        """Each load's own forces, internal unknowns and ports."""
        sizes = [part.sizes for part in self.parts]
        cut = (
            _cut([s.forces for s in sizes], force),
            _cut([s.internal for s in sizes], internal),
            _cut([s.ports for s in sizes], y),
        )
        return list(zip(*cut, strict=True))
