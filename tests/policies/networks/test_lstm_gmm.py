"""NeuralMP's network: its sizes, its parts against formulas, and what it sees and carries."""

from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from flax import nnx

from drpbench.geometry import Obstacles
from drpbench.learning.batches import Batch
from drpbench.learning.learners import learner
from drpbench.learning.learners.lstm_gmm import LstmGmmLearner, sequence
from drpbench.policies.networks.chunks import CHUNK, commanded, decode, lookahead
from drpbench.policies.networks.gaussian_mixture import GaussianMixture
from drpbench.policies.networks.lstm_gmm import LstmGmmNetwork, initial, start, step
from drpbench.policies.networks.lstm_gmm_format import LstmGmmFormat
from drpbench.policies.networks.lstm_gmm_size import FULL, SMALL, LstmGmmSize
from drpbench.policies.weights import WeightsError, load, save
from drpbench.robot import PANDA

from .test_impact import inputs

TINY = LstmGmmSize(
    scene_points=64,
    arm_points=16,
    first_tokens=8,
    first_radius=0.3,
    first_samples=4,
    first_mlp=(8,),
    second_tokens=4,
    second_radius=0.6,
    second_samples=4,
    second_mlp=(8,),
    whole_mlp=(16,),
    scene_mlp=(64, 12),
    lstm_width=10,
    modes=3,
)

run = jax.jit(lambda parameters, *seen: step(TINY, parameters, *seen))


@pytest.fixture(scope="module")
def tiny():
    """A tiny network whose output layer is not small, so that what it sees can be told."""
    parameters = initial(TINY, seed=1)
    parameters["out"]["kernel"] = 30.0 * parameters["out"]["kernel"]
    return parameters


def test_the_full_network_has_about_the_published_number_of_parameters():
    count = sum(leaf.size for leaf in jax.tree.leaves(jax.eval_shape(lambda: initial(FULL))))
    assert 20e6 < count < 22e6  # "20 M", for a cloud of four channels and two postures


def test_the_likelihood_is_that_of_the_formula():
    rng = np.random.default_rng(0)
    logits, mean = rng.normal(size=(4, 3)), rng.normal(size=(4, 3, 7))
    scale, action = rng.uniform(0.2, 2.0, (4, 3, 7)), rng.normal(size=(4, 7))
    share = np.exp(logits) / np.exp(logits).sum(-1, keepdims=True)
    density = np.exp(-0.5 * ((action[:, None] - mean) / scale) ** 2) / scale / np.sqrt(2 * np.pi)
    expected = np.log((share * density.prod(-1)).sum(-1))
    mixture = GaussianMixture(*(jnp.asarray(x, jnp.float32) for x in (logits, mean, scale)))
    found = mixture.log_likelihood(jnp.asarray(action, jnp.float32))
    np.testing.assert_allclose(found, expected, rtol=1e-4)
    likeliest = mixture.likeliest()
    np.testing.assert_allclose(likeliest, mean[np.arange(4), logits.argmax(-1)], rtol=1e-6)


def test_draws_have_the_mixtures_mean_and_spread():
    mixture = GaussianMixture(
        jnp.log(jnp.array([0.25, 0.75])),
        jnp.array([[-4.0], [4.0]]),
        jnp.array([[0.5], [1.0]]),
    )
    drawn = np.asarray(jax.vmap(mixture.draw)(jax.random.split(jax.random.key(0), 4000)))[:, 0]
    low, high = drawn[drawn < 0], drawn[drawn >= 0]
    assert abs(len(low) / 4000 - 0.25) < 0.03
    np.testing.assert_allclose([low.mean(), high.mean()], [-4.0, 4.0], atol=0.1)
    np.testing.assert_allclose([low.std(), high.std()], [0.5, 1.0], atol=0.06)


def test_a_step_of_the_lstm_is_that_of_the_formula():
    network = LstmGmmNetwork(TINY, nnx.Rngs(0))
    rng = np.random.default_rng(1)
    seen = rng.normal(size=12 + 4 * 7)
    state = rng.normal(size=(2, 2, 10))
    _, after = network.go_on(jnp.asarray(seen, jnp.float32), jnp.asarray(state, jnp.float32))

    def sigmoid(x):
        return 1.0 / (1.0 + np.exp(-x))

    x = seen
    for layer, gate in enumerate(network.gates):
        kernel, bias = np.asarray(gate.kernel[...]), np.asarray(gate.bias[...])
        i, f, g, o = np.split(np.concatenate([x, state[0, layer]]) @ kernel + bias, 4)
        cell = sigmoid(f + 1.0) * state[1, layer] + sigmoid(i) * np.tanh(g)
        x = sigmoid(o) * np.tanh(cell)
        np.testing.assert_allclose(after[0, layer], x, atol=1e-5)
        np.testing.assert_allclose(after[1, layer], cell, atol=1e-5)


@pytest.mark.slow
def test_it_sees_scene_arm_goal_and_past_and_nothing_masked(tiny):
    scene, mask, arm, joints, goal = inputs()
    state = start(TINY, (2,))
    plain, after = run(tiny, scene, mask, arm, joints, goal, state)
    hidden = jnp.where(mask[..., None], scene, 5.0)
    masked, _ = run(tiny, hidden, mask, arm, joints, goal, state)
    np.testing.assert_array_equal(masked.mean, plain.mean)
    for changed in (
        (scene * 0.5, mask, arm, joints, goal, state),
        (scene, mask, arm + 0.1, joints, goal, state),
        (scene, mask, arm, joints + 0.1, goal, state),
        (scene, mask, arm, joints, goal * 0.5, state),
        (scene, mask, arm, joints, goal, after),
    ):
        assert float(jnp.abs(run(tiny, *changed)[0].mean - plain.mean).max()) > 1e-4
    empty, _ = run(tiny, scene, jnp.zeros_like(mask), arm, joints, goal, state)
    assert np.isfinite(empty.mean).all()
    one, _ = run(tiny, *(leaf[1] for leaf in (scene, mask, arm, joints, goal, state)))
    np.testing.assert_allclose(one.mean, plain.mean[1], atol=1e-4)


def sample(joints, goal, chunk, points=None, mask=None):
    """A batch of that; its arm and obstacles are those of no scene."""
    count = len(joints)
    points = jnp.zeros((count, 64, 3)) if points is None else points
    mask = jnp.ones((count, 64), bool) if mask is None else mask
    none = jnp.zeros((count, 1), jnp.int32)
    turned = jnp.broadcast_to(jnp.array([1.0, 0.0, 0.0, 0.0]), (count, 1, 4))
    flat = jnp.zeros((count, 1, 3))
    obstacles = jax.vmap(Obstacles.primitives)(Obstacles(none, flat, flat, turned, none > 0))
    return Batch(points, mask, jnp.zeros((count, 256, 3)), joints, goal, chunk, obstacles)


def test_a_sequence_walks_along_the_chunk():
    rng = np.random.default_rng(2)
    joints, goal = rng.uniform(PANDA.joint_lower, PANDA.joint_upper, (2, 3, 7))
    chunk = rng.uniform(-1, 1, (3, CHUNK, 7))
    joints, goal, chunk = (jnp.asarray(x, jnp.float32) for x in (joints, goal, chunk))
    batch = sample(joints, goal, chunk)
    waypoints = decode(chunk, joints, goal)
    where, action = sequence(batch, 2)
    np.testing.assert_allclose(where[:, 0], joints)
    np.testing.assert_allclose(where[:, 1], waypoints[:, 0])
    for at in (0, 1):  # what is commanded there is where the arm shall be three steps later
        rows = jnp.broadcast_to(action[:, at, None], (3, CHUNK, 7))
        target = commanded(rows, where[:, at], goal)
        np.testing.assert_allclose(target, waypoints[:, lookahead() - 1 + at], atol=1e-5)
    with pytest.raises(ValueError, match="horizon must be 1 to 8, got 9"):
        sequence(batch, 9)


@pytest.mark.slow
def test_it_learns_one_batch_by_heart():
    network = LstmGmmLearner(TINY)
    scene, mask, _, joints, goal = inputs(batch=4)
    chunk = jnp.broadcast_to(jnp.sign(goal - joints)[:, None], (4, CHUNK, 7))
    batch = sample(joints, goal, chunk, scene[:, ::32], mask[:, ::32])
    parameters = network.initial(0)

    @jax.jit
    def descended(parameters):
        def down(parameters, _):
            loss, slope = jax.value_and_grad(network.loss)(parameters, batch, "float32")
            return jax.tree.map(lambda p, g: p - 0.01 * g, parameters, slope), loss

        return jax.lax.scan(down, parameters, None, length=60)

    _, losses = descended(parameters)
    assert float(losses[-1]) < float(losses[0]) - 1.0


@pytest.mark.slow
def test_its_weights_are_a_policy_whose_lstm_begins_anew(tiny, tmp_path):
    path = tmp_path / "weights.safetensors"
    facts = dict.fromkeys(("data", "steps", "hardware", "scores", "licence"), "none")
    save(path, LstmGmmFormat(TINY), tiny, facts)
    policy = load(path)
    assert policy.size == TINY and not policy.privileged
    assert "parameters" in policy.about
    observation = _observation()
    carry = policy.init(observation)
    act = jax.jit(policy.act)
    targets = []
    for _ in range(4):
        target, carry = act(observation, carry, None)
        targets.append(np.asarray(target))
    assert np.abs(targets[0] - targets[1]).max() > 1e-7
    np.testing.assert_array_equal(targets[0], targets[2])
    np.testing.assert_array_equal(targets[1], targets[3])
    with pytest.raises(WeightsError, match="unknown network"):
        load(path, {"impact": type(learner("impact", "small"))})


def _observation():
    from drpbench.contract import Observation

    scene, mask, arm, joints, goal = (leaf[0] for leaf in inputs(batch=1))
    return Observation(
        joint_position=joints,
        joint_velocity=jnp.zeros(7),
        goal_joints=goal,
        goal_position=jnp.zeros(3),
        goal_quaternion=jnp.array([1.0, 0.0, 0.0, 0.0]),
        scene_points=scene,
        scene_mask=mask,
        robot_points=arm,
    )


@pytest.mark.parametrize(
    ("change", "wrong"),
    [
        ({"modes": 0}, "modes must be positive, not 0"),
        ({"scene_mlp": ()}, r"scene_mlp must be positive, not \(\)"),
        ({"scene_points": 100}, "scene_points must divide 2048, not be 100"),
    ],
)
def test_impossible_sizes_are_refused(change, wrong):
    with pytest.raises(ValueError, match=wrong):
        replace(SMALL, **change)


def test_settings_come_back_from_a_file():
    network = LstmGmmFormat(SMALL)
    assert LstmGmmFormat.from_settings({**network.settings(), "first_mlp": [32, 64]}) == network
    with pytest.raises(ValueError, match="expected arm_points"):
        LstmGmmFormat.from_settings({"modes": 3})


@pytest.mark.slow
def test_drawn_actions_differ_by_the_key_alone(tiny):
    policy = LstmGmmFormat(TINY).policy(tiny).drawn()
    observation = _observation()
    act = jax.jit(policy.act)
    keys = jax.random.split(jax.random.key(0), 2)
    first, again, other = (
        act(observation, policy.init(observation), key)[0] for key in (keys[0], keys[0], keys[1])
    )
    np.testing.assert_array_equal(first, again)
    assert np.abs(first - other).max() > 1e-6
