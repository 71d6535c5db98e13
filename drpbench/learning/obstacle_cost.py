"""What obstacles cost a configuration, with its gradient and Gauss-Newton Hessian in closed form."""

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from drpbench.geometry import Primitives, nearest, normal
from drpbench.robot import link_poses, moving_spheres


def obstacle_cost(
    q: Float[Array, "7"], obstacles: Primitives, activation: Float[Array, " S"]
) -> tuple[Float[Array, ""], Float[Array, "7"], Float[Array, "7 7"]]:
    """Cost [m^2], gradient and Gauss-Newton Hessian at joints `q` [rad], obstacles (K,) unbatched.

    With d_k the signed distance of the k-th moving sphere's surface to the nearest obstacle:

        r_k = max(0, activation_k - d_k)    cost = sum_k r_k^2 / 2    gradient = -J^T r    H = J^T J

    over the spheres with r_k > 0. Row k of J is n_k . (z_j x (p_k - o_j)) for the joints j up to the
    sphere's link, n_k the obstacle's normal. With screws it needs one cross product a sphere and one
    a joint: n . (z x (p - o)) = z . (p x n) - n . (z x o).
    """
    model = moving_spheres()
    poses = link_poses(q)
    points = model.world(poses)
    distance, which = nearest(points, obstacles)
    n = normal(points, obstacles, which)
    residual = jnp.maximum(activation - (distance - model.radius), 0.0)
    axes, origins = poses.rotation[1:8, :, 2], poses.position[1:8]
    rows = jnp.einsum("kx,jx->kj", jnp.cross(points, n), axes, precision="highest") - jnp.einsum(
        "kx,jx->kj", n, jnp.cross(axes, origins), precision="highest"
    )
    moved = np.arange(1, 8) <= np.minimum(model.frame, 7)[:, None]
    rows = jnp.where(moved & (residual > 0.0)[:, None], rows, 0.0)
    gradient = -jnp.einsum("kj,k->j", rows, residual, precision="highest")
    hessian = jnp.einsum("ki,kj->ij", rows, rows, precision="highest")
    return 0.5 * jnp.sum(residual * residual), gradient, hessian
