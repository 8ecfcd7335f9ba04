"""A robot whose cavities follow the parameters of a layout, differentiably: from θ to body, gas and sensors.

It is built once on the mesh of the layout; then only rest nodes change, and with them what is computed from
them, sealed gas included. The outside stays, so do contacts and electrodes; what is fixed to material points
inside, such as a cable's guides, moves with the material around it.
"""

from jaxtyping import Array, Float

from softfuse.errors import SoftfuseError
from softfuse.mechanics.model import Model, with_body
from softfuse.robot.layout.layout_mesh import LayoutMesh


def model_at(model: Model, mesh: LayoutMesh, theta: Float[Array, " p"]) -> Model:
    """The robot with parameters (p,), built on `mesh` for any others; differentiable in them.

    Raises SoftfuseError when the robot's body is reduced, or was built on another mesh.
    """
    body = model.body.full
    if body.rest.shape != mesh.boxes.shape:
        raise SoftfuseError(
            f"the robot has {len(body.rest)} nodes, the layout's mesh {len(mesh.boxes)}: build it on "
            "LayoutMesh.mesh"
        )
    return with_body(model, body.with_rest(mesh.rest(theta)))
