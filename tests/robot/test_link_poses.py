"""How points on the arm move: along a direction, and as a whole."""

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.robot import PANDA, directional_jacobian, point_jacobian


def test_a_point_moves_along_a_direction_as_its_jacobian_says():
    rng = np.random.default_rng(0)
    q = rng.uniform(PANDA.joint_lower, PANDA.joint_upper).astype(np.float32)
    frame = rng.integers(0, PANDA.hand + 1, 40)
    above = rng.integers(0, frame + 1)
    points, directions = rng.normal(size=(2, 40, 3)).astype(np.float32)

    @jax.jit
    def both(q):
        poses = PANDA.link_poses(q)
        rows = directional_jacobian(
            poses, jnp.asarray(points), jnp.asarray(directions), jnp.asarray(above), frame
        )
        whole, moved = (
            jax.vmap(lambda point, frame: point_jacobian(poses, point, frame))(points, of)
            for of in (frame, above)
        )
        # What moves both frames alike moves the point against the frame above not at all.
        return rows, jnp.einsum("nxj,nx->nj", whole - moved, directions)

    rows, expected = both(q)
    assert rows.shape == (40, PANDA.joints)
    np.testing.assert_allclose(rows, expected, atol=1e-5)
    assert np.all(np.asarray(rows)[frame == above] == 0.0)
