"""Contact torque against virtual work in float64, and what it does to a driven arm."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from drpbench.compile import jit
from drpbench.envs import contact
from drpbench.envs.contact import DAMPING, STIFFNESS
from drpbench.geometry import FAR
from drpbench.robot import PANDA

from ..scenes import batch, bodies, boxes, postures, problem

COUNT = 64
DEEPEST = 0.03  # [m] docs/protocol.md: the depth from which the push no longer grows


@pytest.fixture(scope="module")
def touch():
    """`contact` of 64 configurations, velocities and sets of two boxes."""

    def one(q, qd, obstacles):
        poses = PANDA.link_poses(q)
        return contact(poses, qd, PANDA.moving_spheres.world(poses), obstacles)

    return jit(jax.vmap(one))


@pytest.fixture(scope="module")
def sphere_jacobians():
    """d centre / d q (64, S, 3, 7) of every sphere, by automatic differentiation."""
    centers = jax.jacfwd(lambda q: PANDA.moving_spheres.world(PANDA.link_poses(q)))
    return lambda q: np.asarray(jit(jax.vmap(centers))(q), float)


@pytest.fixture(scope="module")
def touching():
    """64 arms in motion, each with a turned box on one of its spheres and another that is
    masked."""
    rng = np.random.default_rng(0)
    q = postures(COUNT, seed=1)
    qd = (rng.uniform(-0.5, 0.5, (COUNT, 7)) * PANDA.velocity_limit).astype(np.float32)
    centers = bodies(q)[0]
    sets = []
    for b in range(COUNT):
        s = rng.integers(PANDA.moving_spheres.count)
        half = rng.uniform(0.03, 0.15, 3)
        turn = Rotation.random(rng=rng).as_matrix()
        offset = turn @ (rng.choice([-1, 1], 3) * half * rng.uniform(0.6, 1.1, 3))
        placed = boxes((centers[b, s] - offset, half, turn), (centers[b, s], half, turn))
        placed.mask[1] = False
        sets.append(placed)
    return q, qd, batch(sets)


def from_box(points, obstacles):
    """Signed distances (S,) of points to the first box, and gradients (S, 3)."""
    turn, half = obstacles.rotation[0].astype(float), obstacles.half_size[0].astype(float)
    local = (points - obstacles.position[0].astype(float)) @ turn
    distance, gradient = np.empty(len(points)), np.zeros((len(points), 3))
    for i, p in enumerate(local):
        out = p - np.clip(p, -half, half)
        if out.any():
            distance[i] = np.linalg.norm(out)
            gradient[i] = out / distance[i]
        else:
            axis = np.argmin(half - np.abs(p))
            distance[i] = np.abs(p[axis]) - half[axis]
            gradient[i, axis] = np.sign(p[axis])
    return distance, gradient @ turn.T


def by_virtual_work(q, qd, obstacles, jacobians):
    """Torque (7,) by J^T f over the deepest sphere of each frame; clearance; the sphere it is
    of."""
    model = PANDA.moving_spheres
    centers = bodies(q)[0][0].astype(float)
    distance, gradient = from_box(centers, obstacles)
    distance -= model.radius
    torque = np.zeros(7)
    for frame in np.unique(model.frame):
        members = np.nonzero(model.frame == frame)[0]
        s = members[np.argmin(distance[members])]
        if distance[s] < 0.0:
            speed = gradient[s] @ jacobians[s] @ qd
            depth = min(-distance[s], DEEPEST)
            force = max(STIFFNESS * depth - DAMPING * speed, 0.0) * gradient[s]
            torque += jacobians[s].T @ force
    return torque, distance.min(), distance.argmin()


def lane(batched, b):
    return jax.tree.map(lambda leaf: leaf[b], batched)


def links_touching(q, obstacles):
    """On how many frames a sphere is inside the first box."""
    distance, _ = from_box(bodies(q)[0][0].astype(float), obstacles)
    return len(np.unique(PANDA.moving_spheres.frame[distance < PANDA.moving_spheres.radius]))


def test_torque_and_clearance_are_those_of_virtual_work(touch, touching, sphere_jacobians):
    q, qd, obstacles = touching
    found = touch(q, qd, obstacles)
    jacobians = sphere_jacobians(q)
    expected = [
        by_virtual_work(q[b], qd[b].astype(float), lane(obstacles, b), jacobians[b])
        for b in range(COUNT)
    ]
    torque, clearance, sphere = (np.array(values) for values in zip(*expected, strict=True))
    assert (np.abs(torque).max(axis=1) > 1.0).mean() > 0.8
    scale = np.maximum(np.abs(torque).max(axis=1, keepdims=True), 10.0)
    np.testing.assert_allclose(found.torque / scale, torque / scale, atol=1e-3)
    np.testing.assert_allclose(found.clearance, clearance, atol=2e-6)
    np.testing.assert_array_equal(found.sphere, sphere)


def test_contact_pushes_out_harder_when_closing_and_never_pulls(touch, touching):
    q, _, obstacles = touching
    still = touch(q, np.zeros_like(q), obstacles)
    torque = np.asarray(still.torque)
    alone = np.array([links_touching(q[b], lane(obstacles, b)) == 1 for b in range(COUNT)])
    alone &= np.abs(torque).max(axis=1) > 10.0
    assert alone.sum() > 10
    # One contact's torque is J^T n: motion along it leaves the obstacle.
    along = 0.1 * torque / np.maximum(np.linalg.norm(torque, axis=1), 1e-6)[:, None]
    leaving, closing, torn = (touch(q, k * along, obstacles) for k in (1.0, -1.0, 1000.0))

    def power(found):
        return np.sum(np.asarray(found.torque) * along, axis=1)[alone]

    assert (power(still) > 0.0).all()
    assert (power(closing) > power(still)).all()
    assert (power(leaving) < power(still)).all()
    assert (power(leaving) > 0.0).any()
    np.testing.assert_array_equal(np.asarray(torn.torque)[alone], 0.0)


def test_what_is_masked_is_not_there(touch, touching):
    q, qd, obstacles = touching
    obstacles = jax.tree.map(np.array, obstacles)
    obstacles.mask[:] = False
    found = touch(q, qd, obstacles)
    np.testing.assert_array_equal(found.torque, np.zeros((COUNT, 7)))
    assert (found.clearance > 0.9 * FAR).all()


def test_a_world_without_any_obstacle_has_no_contact():
    empty = jax.tree.map(lambda leaf: leaf[:0], boxes())
    poses = PANDA.link_poses(jnp.asarray(PANDA.home, jnp.float32))
    found = contact(poses, jnp.zeros(7), PANDA.moving_spheres.world(poses), empty)
    np.testing.assert_array_equal(found.torque, np.zeros(7))
    assert found.clearance > 0.9 * FAR


def walls(seed, joints, step):
    """16 arms and goals behind a wall 0.5 m thick, that starts 10 cm from the arm."""
    rng = np.random.default_rng(seed)
    radius = PANDA.moving_spheres.radius
    found, sides = [], []
    for q in postures(800, seed):
        goal = q.copy()
        moved = rng.permutation(7)[:joints]
        goal[moved] += rng.choice([-step, step], joints)
        goal = np.clip(goal, PANDA.joint_lower + 0.05, PANDA.joint_upper - 0.05)
        centers = bodies(np.stack([q, goal]))[0]
        axis, sign = rng.integers(3), rng.choice([-1, 1])
        now, then = ((sign * centers[i, :, axis] + radius).max() for i in (0, 1))
        face = now + 0.1
        if face < 0.3 or then < face + 0.15:
            continue
        position, half = np.zeros(3), np.full(3, 2.0)
        position[axis], half[axis] = sign * (face + 0.25), 0.25
        found.append(problem(q, goal, boxes((position, half))))
        sides.append((axis, sign, face))
        if len(found) == 16:
            return batch(found), sides
    raise AssertionError("too few arms reach behind a wall")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("joints", "step", "usual", "deepest"), [(1, 1.8, 0.02, 0.03), (7, 1.2, 0.03, 0.05)]
)
def test_an_arm_driven_into_a_wall_at_full_speed_stops_at_it(drive, joints, step, usual, deepest):
    problems, sides = walls(3, joints, step)
    run = drive(problems)
    depth = -run["clearance"].min(axis=0)
    assert (depth > 0.0).all()
    assert np.median(depth) < usual
    assert depth.max() < deepest
    # At rest before the wall, still aiming behind it.
    assert np.ptp(run["q"][-60:], axis=0).max() < 5e-3
    assert np.abs(run["q"][-1] - problems.goal).max(axis=1).min() > 0.1
    centers = bodies(run["q"][-1])[0]
    for b, (axis, sign, face) in enumerate(sides):
        assert (sign * centers[b, :, axis]).max() < face


@pytest.mark.slow
def test_a_box_that_appears_inside_the_arm_does_not_shoot_it_away(drive):
    q = postures(16, seed=5)
    centers = bodies(q)[0]
    rng = np.random.default_rng(5)
    inside = rng.integers(PANDA.moving_spheres.count, size=16)
    problems = batch(
        [
            problem(q[b], obstacles=boxes((centers[b, inside[b]], rng.uniform(0.05, 0.15, 3))))
            for b in range(16)
        ]
    )
    run = drive(problems)
    assert run["finite"].all()
    assert (run["clearance"][0] < -DEEPEST).mean() > 0.5
    assert np.abs(run["qd"]).max() < 10.0
    assert (np.abs(run["qd"][-60:]).max(axis=(0, 2)) < 0.01).mean() > 0.5
