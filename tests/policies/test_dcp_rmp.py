"""DCP-RMP against the paper's formulas in float64, pseudo-inverses included."""

from dataclasses import fields, replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.spatial import cKDTree

from drpbench.compile import jit
from drpbench.contract import Policy
from drpbench.policies import DcpRmp, Hold, Straight
from drpbench.policies.dcp_rmp import Constants, integrate
from drpbench.robot import PANDA

from ..scenes import bodies, observation, postures

KEY = jax.random.key(0)
STATES = 64


def by_the_paper(c, q, qd, q_goal, x_p, jacobian, x_obs, v_obs):
    """q_mg by the appendix, float64: pull-back, metric-weighted combination, Euler steps."""
    c = {field.name: float(getattr(c, field.name)) for field in fields(c)}
    p, v, obstacle = q.astype(float), qd.astype(float), x_obs.astype(float)
    for _ in range(int(c["euler_steps"])):
        offset = x_p + jacobian @ (p - q) - obstacle
        x_r = offset @ offset
        j_r = 2.0 * offset[None] @ jacobian
        xd_r = (j_r @ v)[0] - 2.0 * offset @ v_obs
        with np.errstate(over="ignore"):
            s = 1.0 - 1.0 / (1.0 + np.exp(-xd_r / c["l_v"]))
        f_r = c["k_p"] * np.exp(-x_r / c["l_p"])
        f_r -= c["k_v"] * s * xd_r / (x_r / c["l_d"] + c["eps_d"])
        g = (x_r - c["r"]) ** 2 / c["r"] ** 2 if x_r <= c["r"] else 0.0
        m_r = s * g * c["mu_r"] / (x_r / c["l_m"] + c["eps_m"])
        metric_r = j_r.T * m_r @ j_r
        pulled = np.linalg.pinv(metric_r, rcond=1e-10, hermitian=True) @ (j_r.T * m_r * f_r)[:, 0]
        metric_g = c["mu_g"] * np.eye(7)
        f_g = c["k_g"] * (q_goal - p) - c["k_d"] * v
        qdd = np.linalg.pinv(metric_r + metric_g, hermitian=True) @ (
            metric_r @ pulled + metric_g @ f_g
        )
        v = v + c["euler_period"] * qdd
        p = p + c["euler_period"] * v
        obstacle = obstacle + c["euler_period"] * v_obs
    return p


def jacobians(q):
    """d centre / d q (B, S, 3, 7) of the collision spheres, by automatic differentiation."""
    centers = jax.jacfwd(lambda q: PANDA.moving_spheres.world(PANDA.link_poses(q)))
    return np.asarray(jit(jax.vmap(centers))(q), float)


@pytest.fixture(scope="module")
def goal_of():
    """The modified goal of one policy, seen the frame `before` and then `now`."""

    def run(policy, before, now):
        _, carry = policy.act(before, policy.init(before), KEY)
        return policy.reaction(now, carry).goal_joints

    return jit(run)


@pytest.fixture(scope="module")
def act():
    return jit(lambda policy, seen, carry: policy.act(seen, carry, KEY))


def near_misses(seed):
    """Random arms in motion, goals, and points 0.1 to 25 cm from a sphere, moving."""
    rng = np.random.default_rng(seed)
    q, goal = np.split(postures(2 * STATES, seed), 2)
    qd = rng.uniform(-0.5, 0.5, q.shape) * PANDA.velocity_limit
    centers = bodies(q)[0].astype(float)
    which = rng.integers(PANDA.moving_spheres.count, size=STATES)
    outward = rng.normal(size=(STATES, 3))
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    x_p = centers[np.arange(STATES), which] + outward * PANDA.moving_spheres.radius[which, None]
    gap = np.exp(rng.uniform(np.log(1e-3), np.log(0.25), (STATES, 1)))
    v_obs = rng.uniform(-0.2, 0.2, (STATES, 3))
    jacobian = jacobians(q)[np.arange(STATES), which]  # of the centre: as good as any for a formula
    return q, qd, goal, x_p, jacobian, x_p + gap * outward, v_obs


@pytest.mark.slow
@pytest.mark.parametrize(
    "constants",
    [
        Constants(),
        Constants(k_d=0.0, euler_steps=1, euler_period=1.0),
        Constants(
            k_p=3.0,
            l_p=0.2,
            l_v=0.5,
            mu_r=20.0,
            r=0.02,
            mu_g=2.0,
            euler_steps=25,
            euler_period=0.02,
        ),
    ],
    ids=["shipped", "one step", "soft"],
)
def test_the_modified_goal_is_that_of_the_paper(constants):
    compiled = jit(jax.vmap(lambda *state: integrate(constants, *state)))
    moved = 0
    for seed in range(3):
        states = near_misses(seed)
        found = np.asarray(compiled(*(np.asarray(a, np.float32) for a in states)), float)
        expected = np.stack(
            [by_the_paper(constants, *(a[b] for a in states)) for b in range(STATES)]
        )
        alone = np.stack(
            [
                by_the_paper(replace(constants, mu_r=0.0), *(a[b] for a in states))
                for b in range(STATES)
            ]
        )
        scale = np.maximum(np.abs(expected).max(axis=1, keepdims=True), 1.0)
        moved += (np.abs(expected - alone).max(axis=1) > 1e-2).sum()
        np.testing.assert_allclose(found / scale, expected / scale, atol=2e-3)
    assert moved > STATES


PERIOD, STILL, APPEARED = 1.0 / 60.0, 5e-4, 0.02  # [s], [m], [m]


def fixed_to(link, local):
    """A point fixed in frame `link` (0 to 8), as a function of the configuration."""

    def point(q):
        poses = PANDA.link_poses(q)
        return poses.position[link] + poses.rotation[link] @ local

    return point


@pytest.fixture(scope="module")
def body_point():
    """Jacobian (3, 7) at q of the arm's point that is at `point` now, on frame `link`."""

    def local(q, link, point):
        poses = PANDA.link_poses(q)
        return poses.rotation[link].T @ (point - poses.position[link])

    def jacobian(q, link, point):
        return jax.jacfwd(fixed_to(link, local(q, link, point)))(q)

    compiled = jit(jacobian)
    return lambda q, link, point: np.asarray(
        compiled(q, np.int32(link), point.astype(np.float32)), float
    )


def by_brute_force(policy, before, now, body_point):
    """q_mg of the frame `now` after the frame `before`, found with a KD-tree; and x_r."""
    old = np.asarray(before.scene_points, float)[np.asarray(before.scene_mask)]
    new = np.asarray(now.scene_points, float)[np.asarray(now.scene_mask)]
    gap, index = cKDTree(old).query(new)
    moving = gap > STILL
    q, goal = np.asarray(now.joint_position), np.asarray(now.goal_joints)
    if not moving.any():
        return goal, np.inf
    model, centers = PANDA.moving_spheres, bodies(q)[0][0].astype(float)
    away = np.linalg.norm(new[:, None] - centers, axis=-1) - model.radius
    first = np.where(moving, away.min(axis=1), np.inf).argmin()
    x_obs, sphere = new[first], away[first].argmin()
    v_obs = (x_obs - old[index[first]]) / PERIOD if gap[first] < APPEARED else np.zeros(3)
    outward = x_obs - centers[sphere]
    length = np.linalg.norm(outward)
    x_p = centers[sphere] + outward / length * min(model.radius[sphere], length - 1e-3)
    x_r = np.sum((x_p - x_obs) ** 2)
    if x_r >= policy.constants.r:
        return goal, x_r
    jacobian = body_point(q, model.frame[sphere], x_p)
    qd = np.asarray(now.joint_velocity, float)
    found = by_the_paper(policy.constants, q, qd, goal, x_p, jacobian, x_obs, v_obs)
    return np.clip(found, PANDA.joint_lower, PANDA.joint_upper), x_r


def frames(seed, step=0.002, distance=(0.0, 0.15)):
    """Two frames of 150 points about an arm in motion: a third of them, 2 cm apart, move
    together."""
    rng = np.random.default_rng(seed)
    q, goal = postures(2, seed)
    centers, radius = bodies(q)[0][0], PANDA.moving_spheres.radius
    scattered = rng.uniform([-0.6, -0.6, 0.0], [0.6, 0.6, 1.0], (100, 3))
    sphere = rng.integers(len(radius))
    outward = rng.normal(size=3)
    outward /= np.linalg.norm(outward)
    place = centers[sphere] + outward * (radius[sphere] + rng.uniform(*distance))
    cluster = place + np.stack(np.meshgrid(*[np.arange(4) * 0.02] * 3), -1).reshape(-1, 3)[:50]
    motion = rng.normal(size=3)
    motion *= step / np.linalg.norm(motion)
    velocity = rng.uniform(-0.3, 0.3, 7)
    before = observation(q, goal, velocity, np.concatenate([scattered, cluster]))
    now = observation(q, goal, velocity, np.concatenate([scattered, cluster + motion]))
    return before, now


@pytest.mark.slow
def test_the_goal_gives_way_as_a_brute_force_search_finds(goal_of, body_point):
    policy = DcpRmp(Straight(), Constants(k_p=3.0, l_p=0.2, l_v=0.5, mu_r=20.0, mu_g=2.0))
    changed = 0
    for seed in range(30):
        before, now = frames(seed)
        expected, x_r = by_brute_force(policy, before, now, body_point)
        found = np.asarray(goal_of(policy, before, now))
        np.testing.assert_allclose(found, expected, atol=2e-3, err_msg=f"seed {seed}, x_r {x_r}")
        changed += np.abs(expected - now.goal_joints).max() > 1e-2
    assert changed > 10


def test_an_obstacle_that_comes_at_a_resting_arm_pushes_the_goal_away(goal_of, body_point):
    """The goal moves so that the arm's closest point draws back from the obstacle."""
    q = np.asarray(postures(20, seed=3))
    centers, model = bodies(q)[0], PANDA.moving_spheres
    drawn_back = []
    for b in range(20):
        sphere = np.nonzero(model.frame >= 5)[0][b]
        outward = centers[b, sphere] - centers[b].mean(axis=0)
        outward /= np.linalg.norm(outward)
        near = centers[b, sphere] + outward * (model.radius[sphere] + 0.05)
        before, now = (observation(q[b], points=[near + k * outward]) for k in (0.003, 0.0))
        moved = np.asarray(goal_of(DcpRmp(Hold()), before, now)) - q[b]
        away = np.linalg.norm(now.scene_points[0] - centers[b], axis=1) - model.radius
        closest = away.argmin()
        jacobian = body_point(q[b], model.frame[closest], centers[b, closest])
        to_obstacle = np.asarray(now.scene_points[0]) - centers[b, closest]
        drawn_back.append(to_obstacle @ jacobian @ moved < 0.0)
    assert np.mean(drawn_back) == 1.0


@pytest.mark.parametrize("why", ["still", "far", "first frame"])
def test_the_goal_is_itself_to_the_bit_where_nothing_dynamic_is_near(goal_of, why):
    policy = DcpRmp(Straight())
    reach = float(np.sqrt(policy.constants.r))
    for seed in range(5):
        before, now = frames(seed, distance=(0.0, 0.02))
        if why == "still":
            before = now
        elif why == "far":
            before, now = frames(seed, distance=(reach + 1.0, reach + 1.1))
        else:
            before = replace(before, scene_mask=jnp.zeros_like(before.scene_mask))
        np.testing.assert_array_equal(goal_of(policy, before, now), now.goal_joints)


@pytest.mark.slow
def test_the_wrapped_policy_is_asked_with_the_modified_goal(act, goal_of):
    policy = DcpRmp(Straight())
    before, now = frames(1, distance=(0.0, 0.02))
    _, carry = act(policy, before, policy.init(before))
    target, _ = act(policy, now, carry)
    goal = np.asarray(goal_of(policy, before, now))
    assert np.abs(goal - now.goal_joints).max() > 1e-3
    q = np.asarray(now.joint_position)
    asked = observation(q, goal, now.joint_velocity)
    np.testing.assert_allclose(target, act(Straight(), asked, ())[0], atol=1e-6)

    class Tells:
        """A policy whose answer is the goal pose that it is shown."""

        privileged = False

        def init(self, seen):
            return ()

        def act(self, seen, carry, key):
            shown = jnp.concatenate([seen.goal_position, seen.goal_quaternion])
            return shown, carry

    pose = jit(lambda before, now: _second(DcpRmp(Tells()), before, now))(before, now)
    np.testing.assert_allclose(pose[:3], asked.goal_position, atol=1e-5)
    assert abs(np.dot(pose[3:], asked.goal_quaternion)) == pytest.approx(1.0, abs=1e-5)


def _second(policy, before, now):
    _, carry = policy.act(before, policy.init(before), KEY)
    return policy.act(now, carry, KEY)[0]


def test_it_goes_over_itself(act):
    twice, once = DcpRmp(DcpRmp(Straight())), DcpRmp(Straight())
    assert isinstance(twice, Policy) and not twice.privileged
    before, now = frames(1, distance=(0.0, 0.02))
    for policy in (twice, once):
        _, carry = act(policy, before, policy.init(before))
        target, after = act(policy, now, carry)
        assert jax.tree.structure(after) == jax.tree.structure(carry)
        assert np.isfinite(target).all()
    # Where nothing moves, neither changes anything.
    for policy in (twice, once):
        _, carry = act(policy, now, policy.init(now))
        target, _ = act(policy, now, carry)
        np.testing.assert_array_equal(target, act(Straight(), now, ())[0])


def test_an_obstacle_inside_the_arm_gives_a_finite_goal_within_the_limits(goal_of):
    for seed in range(5):
        q = postures(1, seed)[0]
        inside = bodies(q)[0][0][5 * seed]
        before, now = (observation(q, points=[inside + k]) for k in (np.float32(0.002), 0.0))
        goal = np.asarray(goal_of(DcpRmp(Hold()), before, now))
        assert np.isfinite(goal).all()
        assert (goal >= PANDA.joint_lower - 1e-6).all() and (goal <= PANDA.joint_upper + 1e-6).all()


def test_privileged_is_what_the_wrapped_policy_is():
    class Sees(Hold):
        privileged = True

    assert DcpRmp(Sees()).privileged and not DcpRmp(Hold()).privileged


def test_the_virtual_second_ends_short_of_a_goal_that_nothing_repels_it_from():
    """Ten Euler steps from rest cover 29.6 % of the way, as docs/policies/dcp-rmp.md says."""
    constants, far = Constants(), jnp.array([10.0, 0.0, 0.0])
    rest, goal = jnp.zeros(7), jnp.linspace(-1.0, 1.0, 7)
    found = integrate(
        constants, rest, rest, goal, jnp.zeros(3), jnp.zeros((3, 7)), far, jnp.zeros(3)
    )
    np.testing.assert_allclose(found, 0.2957 * goal, atol=1e-4)
