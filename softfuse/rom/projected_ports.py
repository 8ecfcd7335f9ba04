"""What acts on a body as what it is on a reduced one: rows of a few numbers instead of nodes.

Ports that are linear in the nodes are linear in the modes' amplitudes, y = y₀ + Gᵀ z with G = Uᵀ G_full, and
the springs that support them stiffen the modes by G k Gᵀ. The volumes of cavities are `ProjectedVolumes`.
A disc may press wherever the reduced body watches the nodes: only where it lands is found anew each time.
"""

from dataclasses import replace
from functools import singledispatch

import equinox as eqx
import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from softfuse.body.body import Body
from softfuse.errors import SolveError
from softfuse.functional.contact import Contact, ContactSurface, SeenFaces
from softfuse.mechanics.indenters import FlatIndenter, SurfacePatches
from softfuse.mechanics.load import AbstractContact, AbstractLoad, AbstractPorts, LinearPorts
from softfuse.mechanics.model import parts_of
from softfuse.mechanics.patch import NormalPatches
from softfuse.mechanics.points import AbstractGuides
from softfuse.mechanics.punch import Punch
from softfuse.mechanics.surface_ports import CellPorts, PlacePorts
from softfuse.mechanics.volume import VolumePorts
from softfuse.rom.basis import Basis
from softfuse.rom.projected_volume import ProjectedVolumes, projected_volumes
from softfuse.rom.reduced_body import ReducedBody
from softfuse.rom.teaching import Chart


class ProjectedGuides(AbstractGuides):
    """Places in a body: `rest` y₀ (3 g,) [m], `slopes` G (n, 3 g) [m], `springs` k (3 g,) [N/m]."""

    rest: Float[Array, " p"]
    slopes: Float[Array, "n p"]
    springs: Float[Array, " p"]

    @property
    def location(self):
        """Where they are on the body at rest (g, 3) [m]."""
        return self.rest.reshape(-1, 3)

    def values(self, body, z):
        """y₀ + Gᵀ z (3 g,) [m]."""
        del body
        return self.rest + self.slopes.T @ z

    def rows(self, body, z):
        """G (n, 3 g)."""
        del body, z
        return self.slopes

    def stiffen(self, body, z, force, tangents):
        """The tangent (1, n, n) with the supporting springs."""
        del body, z, force
        return tangents + (self.slopes * self.springs) @ self.slopes.T

    @property
    def supports(self):
        """The springs (3 g,) [N/m]."""
        return self.springs


class ProjectedVolumePorts(AbstractPorts):
    """The volumes (p,) [m³] of cavities."""

    volumes: ProjectedVolumes

    def values(self, body, z):
        """V (p,) [m³]."""
        return self.volumes.rest + self.volumes.change(body, z)

    def rows(self, body, z):
        """∂V/∂z (n, p) [m³]."""
        return jax.jacrev(lambda x: self.values(body, x))(z).T

    def stiffen(self, body, z, force, tangents):
        """The tangent (1, n, n) minus Σ p ∂²V/∂z² for pressures `force` (p,) [Pa]."""
        del body
        return tangents - self.volumes.bent(force, z)

    @property
    def supports(self):
        """No springs."""
        return jnp.zeros_like(self.volumes.rest)

    def resultants(self, body, z):
        """Nothing: rigid motions keep the volume inside a closed surface (6, p)."""
        del body, z
        return jnp.zeros((6, len(self.volumes.rest)))


class ProjectedPatches(AbstractContact):
    """Patches at e points (e, 3) m, each place being taken for the nearest: their `offsets` (c,) [m], and the
    ports of their frames, `rest` (e, 9 c) and `slopes` (e, n, 9 c).
    """

    offsets: Float[Array, " c"]
    points: Float[Array, "e 3"]
    rest: Float[Array, "e p"]
    slopes: Float[Array, "e n p"]

    @property
    def arms(self):
        """Those of the patches."""
        return self.offsets

    def load(self, body, place):
        """The patches at the point nearest to a place."""
        del body
        number = jnp.argmin(jnp.sum((self.points - place[0]) ** 2, axis=1))
        return NormalPatches(PlacePorts(self.rest[number], self.slopes[number], self.drives))


class ProjectedDiscs(AbstractContact):
    """Discs anywhere on a surface: `disc` on faces of watched nodes, numbered among these, w otherwise;
    `watched` (w + 1,): the body's numbers of these, `seen` where they are at rest, and what a newton on each
    does to the modes, `slopes` (m, w); of n unknowns.
    """

    disc: Contact
    watched: Int[Array, " w_plus_1"]
    seen: SeenFaces
    slopes: Float[Array, "m w"]
    n: int = eqx.field(static=True)

    @property
    def arms(self):
        """The total force, at the place."""
        return jnp.zeros(1)

    def load(self, body, place):
        """The disc at a place; NaN where it lands on a node that is not watched."""
        disc = eqx.tree_at(lambda disc: disc.location, self.disc, place[0])
        on = disc.surface.land_on(self.seen, disc.points)
        (m, w), count = self.slopes.shape, disc.cells.count
        parts, nodes = disc.parts(on), self.watched[on.nodes]
        pushed = jnp.zeros((count, w + 1)).at[disc.cells.cell[:, None], on.nodes].add(parts)
        rows = jnp.einsum("mw,cw->mc", self.slopes, pushed[:, :w].astype(self.slopes.dtype)).astype(float)
        lost = jnp.where(pushed[:, w] != 0, jnp.nan, 0.0)
        slopes = jnp.concatenate([rows + lost, jnp.zeros((self.n - m, count))])
        heights = disc.heights(eqx.tree_at(lambda o: o.nodes, on, nodes), body.rest)
        cell, along = disc.cells.cell, disc.surface.direction
        return Punch.on(CellPorts(heights, slopes, along, nodes, parts, cell), disc, body)


@singledispatch
def projected_contact(
    contact: AbstractContact, body: Body, small: ReducedBody, basis: Basis, places: Float[np.ndarray, "e 3 3"]
) -> AbstractContact:
    """A contact of a full body on its reduced one of some modes, patches at places (e, 3, 3) only where there
    are any.
    """
    del body, basis, places
    return projected_discs(contact, small)


@singledispatch
def projected_discs(contact: AbstractContact, small: ReducedBody) -> AbstractContact:
    """What presses anywhere on a reduced body: discs along one direction in a few numbers, others as they are
    on the full one, which looks at more nodes at once.
    """
    del small
    return contact


@projected_discs.register
def _(contact: FlatIndenter, small: ReducedBody) -> AbstractContact:
    for along in parts_of(contact.surface, ContactSurface):
        faces, watched, seen, slopes = _seen_by_discs(along, small)
        surface = replace(along, faces=faces)
        disc = Contact(surface, contact.cells, jnp.zeros(3), contact.radius, contact.compliance)
        return ProjectedDiscs(disc, watched, seen, slopes, small.n)
    return contact


@eqx.filter_jit
def _seen_by_discs(surface: ContactSurface, small: ReducedBody) -> tuple[Array, Array, SeenFaces, Array]:
    # One program, as a dozen small ones would take a second to compile.
    along = jnp.einsum("wim,i->mw", small.seen_shapes, surface.direction.astype(small.seen_shapes.dtype))
    # Those that are watched come first when sorted by their places; one more stands for all others.
    watched = jnp.argsort(small.seen, stable=True)[: small.seen_shapes.shape[0] + 1]
    return small.seen[surface.faces], watched, surface.seen(small.rest), along


@projected_contact.register
def _(
    contact: SurfacePatches, body: Body, small: ReducedBody, basis: Basis, places: Float[np.ndarray, "e 3 3"]
) -> AbstractContact:
    if not len(places):
        return projected_discs(contact, small)

    @eqx.filter_jit
    def frames(contact: SurfacePatches, body: Body, place: Array) -> PlacePorts:
        return contact.load(body, place).ports

    each = [frames(contact, body, jnp.asarray(place)) for place in places]
    slopes = [basis.columns.T @ np.asarray(ports.slopes) for ports in each]
    return ProjectedPatches(
        contact.offsets,
        jnp.asarray(places[:, 0]),
        jnp.stack([ports.rest for ports in each]),
        jnp.asarray(np.stack(slopes)),
    )


def projected_load(load: AbstractLoad, body: Body, small: ReducedBody, chart: Chart) -> AbstractLoad:
    """A load of a full body on the reduced one of a chart. Raises SolveError where it has no projection."""
    return eqx.tree_at(lambda of: of.ports, load, _projected(load.ports, body, small, chart))


@singledispatch
def _projected(ports: AbstractPorts, body: Body, small: ReducedBody, chart: Chart) -> AbstractPorts:
    del body, small, chart
    raise SolveError(f"a body with {type(ports).__name__} attached cannot be reduced")


@_projected.register
def _(ports: LinearPorts, body: Body, small: ReducedBody, chart: Chart) -> LinearPorts:
    del body, small
    return LinearPorts(ports.rest, jnp.asarray(chart.basis.columns.T @ np.asarray(ports.slopes)))


@_projected.register
def _(ports: AbstractGuides, body: Body, small: ReducedBody, chart: Chart) -> ProjectedGuides:
    del small
    rows = np.asarray(eqx.filter_jit(lambda ports, body: ports.rows(body, jnp.zeros(body.n)))(ports, body))
    slopes = jnp.asarray(chart.basis.columns.T @ rows)
    return ProjectedGuides(ports.location.ravel(), slopes, ports.supports)


@_projected.register
def _(ports: VolumePorts, body: Body, small: ReducedBody, chart: Chart) -> ProjectedVolumePorts:
    del body
    return ProjectedVolumePorts(projected_volumes(ports.cavities, small, chart.reach))
