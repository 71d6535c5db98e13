"""The network: sizes, what it sees and what it does not, and that batching changes nothing."""

import functools
import subprocess
import sys
from dataclasses import replace

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.policies.networks.arm import normalised
from drpbench.policies.networks.chunks import CHUNK
from drpbench.policies.networks.feelers import feeler_points
from drpbench.policies.networks.impact import (
    apply,
    initial,
    positional_encoding,
    shapes,
)
from drpbench.policies.networks.impact_size import FULL, SMALL, ImpactSize
from drpbench.robot import PANDA

pytestmark = pytest.mark.slow

TINY = ImpactSize(
    scene_points=64,
    scene_tokens=6,
    robot_points=32,
    robot_tokens=3,
    radius=0.3,
    samples=8,
    point_mlp=(8, 16),
    joint_mlp=(16,),
    width=16,
    feed_forward=24,
    heads=2,
    encoder_layers=1,
    decoder_layers=1,
)


def count(size):
    return sum(leaf.size for leaf in jax.tree.leaves(jax.eval_shape(lambda: initial(size))))


def inputs(batch=2, seed=0):
    rng = np.random.default_rng(seed)
    lower, upper = PANDA.joint_lower, PANDA.joint_upper
    return (
        jnp.asarray(rng.uniform(-0.6, 0.6, (batch, 2048, 3)), jnp.float32),
        jnp.asarray(rng.random((batch, 2048)) < 0.9),
        jnp.asarray(rng.uniform(-0.4, 0.4, (batch, 256, 3)), jnp.float32),
        *(jnp.asarray(rng.uniform(lower, upper, (batch, 7)), jnp.float32) for _ in range(2)),
    )


# Two samples everywhere: each of these is compiled once.
run = jax.jit(lambda parameters, *seen: apply(TINY, parameters, *seen))
descent = jax.jit(
    jax.value_and_grad(
        lambda parameters, wanted, *seen: jnp.mean(
            jnp.square(apply(TINY, parameters, *seen) - wanted)
        )
    )
)


@pytest.fixture(scope="module")
def tiny():
    """A tiny network whose output layer is not small, so that what it sees can be told."""
    parameters = initial(TINY, seed=1)
    parameters["out"]["kernel"] = 30.0 * parameters["out"]["kernel"]
    return parameters, functools.partial(run, parameters)


def test_the_full_network_has_the_papers_number_of_parameters():
    assert abs(count(FULL) / 4.67e6 - 1.0) < 0.05


def test_the_small_network_is_the_papers_but_for_its_feelers():
    deep, small = jax.eval_shape(lambda: initial(FULL)), jax.eval_shape(lambda: initial(SMALL))
    assert set(small) - set(deep) == {"feeler", "places"} and not set(deep) - set(small)
    for stack in ("encoder", "decoder"):
        layers = {
            jax.tree.structure(layer)
            for network in (deep, small)
            for layer in network[stack].values()
        }
        assert len(layers) == 1  # as many as there are, each of them the same
    assert (len(small["encoder"]), len(small["decoder"])) == (2, 1)
    for name in set(deep) - {"encoder", "decoder", "scene", "robot"}:
        assert jax.tree.structure(small[name]) == jax.tree.structure(deep[name]), name
    for cloud in ("scene", "robot"):
        assert set(small[cloud]) == set(deep[cloud])
    # The arm at its goal is a type of token more than the paper's network has.
    assert small["types"].shape[0] == deep["types"].shape[0] + 1
    assert count(SMALL) < 0.1 * count(FULL)


def test_parameters_are_float32_and_follow_the_seed():
    leaves = jax.tree.leaves(initial(TINY))
    assert {leaf.dtype for leaf in leaves} == {jnp.dtype("float32")}
    same, other = jax.tree.leaves(initial(TINY)), jax.tree.leaves(initial(TINY, seed=1))
    assert all((a == b).all() for a, b in zip(leaves, same, strict=True))
    assert any((a != b).any() for a, b in zip(leaves, other, strict=True))


def test_an_untrained_network_answers_little():
    chunk = run(initial(TINY), *inputs())
    assert chunk.shape == (2, CHUNK, 7) and chunk.dtype == jnp.float32
    assert 0 < float(jnp.abs(chunk).max()) < 1.0
    # Already each row of the chunk is its own.
    assert float(jnp.abs(jnp.diff(chunk, axis=-2)).max()) > 0


def test_one_by_one_vmapped_or_as_a_batch_it_is_the_same(tiny):
    _, compiled = tiny
    seen = inputs()
    batch = compiled(*seen)
    single = jnp.stack([compiled(*(leaf[i] for leaf in seen)) for i in range(2)])
    np.testing.assert_allclose(single, batch, atol=2e-5)
    np.testing.assert_allclose(jax.jit(jax.vmap(compiled))(*seen), batch, atol=2e-5)


@pytest.mark.parametrize("which", range(5))
def test_every_input_matters(tiny, which):
    _, compiled = tiny
    seen, other = list(inputs()), inputs(seed=7)
    before = compiled(*seen)
    seen[which] = other[which]
    assert float(jnp.abs(compiled(*seen) - before).max()) > 1e-3


def test_where_the_scene_stands_matters(tiny):
    """Relative neighbourhoods are the same; only the centres' positions tell."""
    _, compiled = tiny
    points, *rest = inputs()
    moved = points + jnp.asarray([0.25, 0.0, 0.0])
    assert float(jnp.abs(compiled(moved, *rest) - compiled(points, *rest)).max()) > 1e-3


def test_masked_points_do_not_matter(tiny):
    _, compiled = tiny
    points, mask, *rest = inputs()
    other = jnp.where(mask[..., None], points, 5.0)
    np.testing.assert_array_equal(compiled(other, mask, *rest), compiled(points, mask, *rest))


def test_an_empty_scene_is_finite_and_not_a_scene(tiny):
    parameters, compiled = tiny
    points, mask, *rest = inputs()
    empty = compiled(jnp.zeros_like(points), jnp.zeros_like(mask), *rest)
    assert np.isfinite(empty).all()
    at_origin = compiled(jnp.zeros_like(points), mask, *rest)
    assert float(jnp.abs(empty - at_origin).max()) > 1e-4

    _, gradient = descent(
        parameters, jnp.ones((2, CHUNK, 7)), jnp.zeros_like(points), jnp.zeros_like(mask), *rest
    )
    assert all(np.isfinite(leaf).all() for leaf in jax.tree.leaves(gradient))


def test_at_the_goal_it_is_finite_and_near_it_the_direction_tells(tiny):
    _, compiled = tiny
    points, mask, robot, joints, _ = inputs()
    assert np.isfinite(compiled(points, mask, robot, joints, joints)).all()
    step = jnp.asarray([1e-3, 0, 0, 0, 0, 0, 0])
    there = compiled(points, mask, robot, joints, joints + step)
    back = compiled(points, mask, robot, joints, joints - step)
    assert float(jnp.abs(there - back).max()) > 1e-2


def test_every_parameter_is_trained(tiny):
    parameters, _ = tiny
    _, gradient = descent(parameters, jnp.ones((2, CHUNK, 7)), *inputs())
    silent = [
        jax.tree_util.keystr(path)
        for path, leaf in jax.tree_util.tree_leaves_with_path(gradient)
        if not (jnp.abs(leaf) > 0).any()
    ]
    assert not silent


def test_half_precision_is_close(tiny):
    parameters, compiled = tiny
    seen = inputs()
    half = jax.jit(lambda *seen: apply(TINY, parameters, *seen, dtype="bfloat16"))(*seen)
    assert half.dtype == jnp.float32
    full = compiled(*seen)
    assert 0 < float(jnp.abs(half - full).max()) < 0.05 * float(jnp.abs(full).max())


def test_a_few_steps_of_descent_fit_a_batch(tiny):
    parameters, _ = tiny
    seen = inputs()
    wanted = jnp.asarray(np.random.default_rng(0).normal(size=(2, CHUNK, 7)), jnp.float32)
    values = []
    for _ in range(60):
        value, gradient = descent(parameters, wanted, *seen)
        parameters = jax.tree.map(lambda p, g: p - 0.05 * g, parameters, gradient)
        values.append(float(value))
    assert values[-1] < 0.7 * values[0]


def test_joint_limits_are_the_ends_of_the_range():
    np.testing.assert_allclose(
        normalised(jnp.asarray(PANDA.joint_lower, jnp.float32)), -1.0, atol=1e-6
    )
    np.testing.assert_allclose(
        normalised(jnp.asarray(PANDA.joint_upper, jnp.float32)), 1.0, atol=1e-6
    )


def test_positional_encoding_tells_a_centimetre():
    rng = np.random.default_rng(0)
    points = jnp.asarray(rng.uniform(-1.2, 1.2, (400, 3)), jnp.float32)
    code = positional_encoding(points, 64)
    assert code.shape == (400, 64) and float(jnp.abs(code).max()) <= 1.0
    away = jnp.linalg.norm(code[:, None] - code[None], axis=-1)
    apart = jnp.linalg.norm(points[:, None] - points[None], axis=-1) > 0.2
    assert float(away[apart].min()) > 1.0
    step = positional_encoding(points + 0.01, 64) - code
    assert float(jnp.linalg.norm(step, axis=-1).min()) > 0.3


def test_other_policies_do_not_import_flax():
    program = "import sys, drpbench.policies; assert 'flax' not in sys.modules, 'flax is imported'"
    subprocess.run([sys.executable, "-c", program], check=True)


FEELING = replace(TINY, feelers=5)


@pytest.fixture(scope="module")
def feeling():
    parameters = initial(FEELING, seed=1)
    parameters["out"]["kernel"] = 30.0 * parameters["out"]["kernel"]
    return jax.jit(functools.partial(apply, FEELING, parameters))


def with_points(center, radius=0.05):
    """A scene far from the arm, and in it some points that only feelers look at, around a place
    [m]."""
    _, mask, *rest = inputs()
    rng = np.random.default_rng(5)
    points = np.full((2, 2048, 3), [3.0, 3.0, 0.0]) + rng.normal(0.0, 0.1, (2, 2048, 3))
    stride = 2048 // FEELING.scene_points
    points[:, 1::stride] = center + rng.uniform(-radius, radius, points[:, 1::stride].shape)
    return jnp.asarray(points, jnp.float32), jnp.ones_like(mask), *rest


@pytest.mark.parametrize("which", [3, 4])
def test_feelers_feel_what_is_near_the_arm_and_its_goal(feeling, which):
    seen = with_points([0.0, 0.0, 5.0])
    poses = PANDA.link_poses(seen[which][0])
    hand = feeler_points(FEELING.feelers).world(poses)[-1]
    near = feeling(*with_points(np.asarray(hand)))[0] - feeling(*seen)[0]
    assert float(jnp.abs(near).max()) > 1e-3


def test_feelers_do_not_feel_what_is_far(feeling):
    far = feeling(*with_points([0.0, 0.0, 5.0])), feeling(*with_points([0.0, 5.0, 0.0]))
    np.testing.assert_array_equal(*far)


def test_feelers_are_spread_from_the_forearm_to_the_fingers():
    model = feeler_points(12)
    places = np.asarray(model.world(PANDA.link_poses(jnp.asarray(PANDA.home, jnp.float32))))
    gap = np.linalg.norm(places[:, None] - places, axis=-1) + 10 * np.eye(12)
    assert model.count == 12 and set(model.frame) >= {3, 5, 7, 8} and gap.min() > 0.05


def test_more_feelers_than_places_are_refused():
    with pytest.raises(ValueError, match="feelers must be 0 to"):
        shapes(replace(TINY, feelers=1000))
