"""Policies by name, and that each of them is one."""

import importlib.util
from dataclasses import replace
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from drpbench.baselines import Rmp
from drpbench.compile import jit
from drpbench.contract import Policy
from drpbench.errors import DrpbenchError
from drpbench.plugins.host import Hosted
from drpbench.plugins.registry import POLICIES, WRAPPERS, UnknownPolicy, make, parameters
from drpbench.policies import DcpRmp, Hold, Straight
from drpbench.policies.weights import WeightsError, shipped

from ..scenes import boxes, observation, postures

ON_HOST = {"curobo", "ompl"}
IN_JAX = [name for name in POLICIES if name not in ON_HOST]
NAMES = [*IN_JAX, "straight+dcp-rmp"]


def test_names_make_policies():
    assert make("hold") == Hold() and make("straight") == Straight() and make("rmp") == Rmp()
    assert make("straight+dcp-rmp") == DcpRmp(Straight())
    assert make("rmp+dcp-rmp+dcp-rmp") == DcpRmp(DcpRmp(Rmp()))


@pytest.mark.parametrize("name", ["", "RMP", "dcp-rmp", "nothing+dcp-rmp"])
def test_an_unknown_policy_lists_those_there_are(name):
    with pytest.raises(UnknownPolicy) as error:
        make(name)
    message = str(error.value)
    assert repr(name.split("+")[0]) in message and "\n" not in message
    assert all(known in message for known in (*POLICIES, *WRAPPERS))


@pytest.mark.parametrize("name", ["rmp+", "rmp+rmp", "straight+dcp-rmp+x"])
def test_an_unknown_wrapper_lists_those_there_are(name):
    with pytest.raises(UnknownPolicy) as error:
        make(name)
    message = str(error.value)
    assert repr(name.split("+")[-1]) in message and "\n" not in message
    assert all(known in message for known in WRAPPERS)


def test_every_policy_says_what_it_is():
    for _, description in (*POLICIES.values(), *WRAPPERS.values()):
        assert description and "\n" not in description


def test_parameters_name_every_number():
    assert parameters(Hold()) == {}
    assert parameters(Straight(0.7)) == {"speed": 0.7}
    found = parameters(DcpRmp(Straight()))
    assert found["policy.speed"] == Straight().speed
    assert found["constants.r"] == DcpRmp(Straight()).constants.r
    assert found["constants.euler_steps"] == DcpRmp(Straight()).constants.euler_steps
    leaves = jax.tree.leaves(DcpRmp(Straight()))
    assert len(found) == len(leaves) + 1  # and the number of Euler steps, which is static


@pytest.mark.parametrize("name", sorted(ON_HOST))
def test_those_that_act_on_the_host_are_hosted_or_say_what_they_lack(name):
    try:
        policy = make(name)
    except DrpbenchError as error:
        assert str(error).startswith(f"{name}: ") and "\n" not in str(error)
        assert importlib.util.find_spec(name) is None
    else:
        assert isinstance(policy, Hosted) and isinstance(policy.privileged, bool)


@pytest.mark.slow
@pytest.mark.parametrize("name", NAMES)
def test_every_policy_keeps_the_protocol(name):
    """A pytree; pure; vmapped with itself shared; targets (7,) float32; a carry whose form never
    changes."""
    try:
        policy = make(name)
    except WeightsError as error:
        if shipped():
            raise
        pytest.skip(str(error))
    assert isinstance(policy, Policy) and isinstance(policy.privileged, bool)
    leaves, form = jax.tree.flatten(policy)
    assert jax.tree.unflatten(form, leaves) == policy
    assert all(np.isscalar(leaf) or isinstance(leaf, np.ndarray | jax.Array) for leaf in leaves)

    q = postures(4)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3))
    models = boxes(((0.5, 0.6, 0.3), (0.05, 0.05, 0.05))) if policy.privileged else None
    seen = [
        replace(observation(a, b, points=points), obstacles=models)
        for a, b in zip(q[:2], q[2:], strict=True)
    ]
    seen = jax.tree.map(lambda *leaves: jnp.stack(leaves), *seen)
    keys = jax.random.split(jax.random.key(0), 2)

    def two(policy, seen, keys):
        carry = jax.vmap(policy.init)(seen)
        target, after = jax.vmap(policy.act)(seen, carry, keys)
        assert jax.tree.structure(after) == jax.tree.structure(carry)
        return target, *map(jax.tree.leaves, (carry, after))

    # Minutes to compile, and run in tests of their own: here their forms alone.
    alone = name in ("trajopt", "trajopt-vox")
    ran = partial(jax.eval_shape, two) if alone else jit(two)
    target, *carries = ran(policy, seen, keys)
    assert target.shape == (2, 7) and target.dtype == jnp.float32
    form = [[(leaf.shape, leaf.dtype) for leaf in leaves] for leaves in carries]
    assert form[0] == form[1]
    if not alone:
        assert np.isfinite(target).all()
        np.testing.assert_array_equal(ran(policy, seen, keys)[0], target)
