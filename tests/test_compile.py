"""The compiler's options: given where they are needed, and doing what they are for."""

import contextlib
import time

import jax
import jax.numpy as jnp
import mujoco
import numpy as np
import pytest
from mujoco import mjx

from drpbench import compile
from drpbench.robot import PANDA

BATCH = 256


def test_jit_computes_and_takes_the_options_of_jax_jit():
    power = compile.jit(lambda x, n: x**n, static_argnums=1)
    np.testing.assert_array_equal(power(jnp.arange(4.0), 3), [0.0, 1.0, 8.0, 27.0])
    assert power.lower(jnp.arange(4.0), 2).compile() is not None


@pytest.mark.parametrize(
    ("version", "backend", "needed"),
    [
        ("0.10.2", "cpu", True),
        ("0.7.0", "cpu", True),
        ("0.11.0", "cpu", False),
        ("0.12.0.dev1", "cpu", False),
        ("1.0", "cpu", False),
        ("0.10.2", "gpu", False),
    ],
)
def test_the_option_is_given_only_where_it_is_known_and_needed(
    monkeypatch, version, backend, needed
):
    given = {}
    monkeypatch.setattr(jax, "__version__", version)
    monkeypatch.setattr(jax, "default_backend", lambda: backend)
    monkeypatch.setattr(jax, "jit", lambda function, **options: given.update(options))
    compiled = compile.jit(len, static_argnums=0)
    assert not given  # no backend is asked for before the first call
    with contextlib.suppress(TypeError):
        compiled([])
    assert given.pop("static_argnums") == 0
    assert given == ({"compiler_options": {"xla_cpu_use_fusion_emitters": False}} if needed else {})


def quickest(function, *arguments):
    """Seconds of the fastest of several calls, the compilation left out."""
    jax.block_until_ready(function(*arguments))
    times = []
    for _ in range(15):
        start = time.perf_counter()
        jax.block_until_ready(function(*arguments))
        times.append(time.perf_counter() - start)
    return min(times)


@pytest.mark.slow
@pytest.mark.skipif(jax.default_backend() != "cpu", reason="the trap is the CPU backend's")
def test_mjx_kinematics_does_not_fall_into_the_trap():
    """MJX's kinematics of the arm costs about 10 of our own; in the trap, over 100,000."""
    model = mjx.put_model(mujoco.MjModel.from_xml_path(str(PANDA.model)))
    data = mjx.make_data(model)
    q = (
        np.random.default_rng(0)
        .uniform(PANDA.joint_lower, PANDA.joint_upper, (BATCH, 7))
        .astype(np.float32)
    )

    @compile.jit
    @jax.vmap
    def by_mjx(q):
        return mjx.kinematics(model, data.replace(qpos=q)).xpos

    by_us = compile.jit(jax.vmap(PANDA.link_poses))
    np.testing.assert_allclose(by_mjx(q)[:, 1:10], by_us(q).position, atol=1e-5)
    assert quickest(by_mjx, q) < 200 * quickest(by_us, q)


def test_stored_values_are_the_same_values():
    floats = jnp.array([[0.0, -0.0, 1.5], [-1e6, 1e6, 1e-30]])
    np.testing.assert_array_equal(compile.stored(floats), floats)
    integers = jnp.array([0, -5, 2**31 - 2], jnp.int32)
    np.testing.assert_array_equal(compile.stored(integers), integers)
    assert np.isnan(compile.stored(jnp.array([jnp.nan]))).all()


def test_stored_values_have_their_derivatives():
    def half_square(x):
        return jnp.sum(compile.stored(x * x)) / 2.0

    x = jnp.array([3.0, -2.0])
    np.testing.assert_allclose(jax.grad(half_square)(x), x)
    np.testing.assert_allclose(jax.jvp(half_square, (x,), (jnp.ones(2),))[1], 1.0)


def test_stored_values_are_kept_by_a_loop_that_the_compiler_leaves_alone():
    def program(x):
        return compile.stored(jnp.sin(x))

    for x in (jnp.ones(4), jnp.ones(4, jnp.int32)):
        text = compile.jit(program if x.dtype == jnp.float32 else compile.stored).lower(x)
        assert "while" in text.compile().as_text()
