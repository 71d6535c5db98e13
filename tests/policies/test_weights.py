"""Weights on disk: what is saved is loaded, and what is damaged is refused in one line."""

import json
import struct
from dataclasses import asdict, dataclass
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from safetensors.numpy import load_file, save_file

from drpbench.compile import jit
from drpbench.contract import Policy, observation_spec
from drpbench.plugins.imported import nothing_seen
from drpbench.plugins.registry import parameters as header_parameters
from drpbench.policies import weights
from drpbench.policies.networks import Network
from drpbench.policies.networks.chunks import commanded
from drpbench.policies.networks.impact import apply, initial
from drpbench.policies.networks.impact_format import ImpactFormat
from drpbench.policies.networks.impact_policy import Impact
from drpbench.policies.networks.impact_size import ImpactSize
from drpbench.policies.weights import FACTS, WeightsError, load, save

from ..scenes import observation, postures
from ..toy_arm import toy_arm

TINY = ImpactSize(
    scene_points=32,
    scene_tokens=4,
    robot_points=16,
    robot_tokens=2,
    radius=0.3,
    samples=4,
    point_mlp=(8,),
    joint_mlp=(8,),
    width=12,
    feed_forward=12,
    heads=2,
    encoder_layers=1,
    decoder_layers=1,
)
NETWORK = ImpactFormat(TINY)
CARD = {
    "data": "100 problems",
    "steps": 5,
    "hardware": "a | b",
    "scores": {"SE": "1/10", "GB": "2/10"},
    "licence": "Apache-2.0",
}


@pytest.fixture(scope="module")
def policy():
    return NETWORK.policy(initial(TINY))


@pytest.fixture
def file(policy, tmp_path):
    path = tmp_path / "tiny.safetensors"
    save(path, NETWORK, policy.parameters, CARD)
    return path


def refused(path):
    with pytest.raises(WeightsError) as error:
        load(path)
    message = str(error.value)
    assert "\n" not in message and str(path) in message
    return message


def rewritten(path, tensors=None, **metadata):
    """The file again with other tensors or metadata, its own checksum untouched."""
    with open(path, "rb") as file:
        (length,) = struct.unpack("<Q", file.read(8))
        old = json.loads(file.read(length))["__metadata__"]
    save_file(tensors or load_file(path), path, metadata=old | metadata)
    return path


def test_what_is_saved_is_loaded(policy, file):
    found = load(file)
    assert found.size == TINY and jax.tree.structure(found) != jax.tree.structure(policy)
    assert jax.tree.structure(found.parameters) == jax.tree.structure(policy.parameters)
    jax.tree.map(np.testing.assert_array_equal, found.parameters, policy.parameters)
    assert load(str(file)).weights == found.weights != ""
    assert weights.card(file) == CARD
    assert sorted(path.name for path in file.parent.iterdir()) == ["tiny.md", "tiny.safetensors"]


def test_the_card_says_every_fact(file):
    text = file.with_suffix(".md").read_text()
    assert text.startswith("# tiny\n") and load(file).weights in text
    for line in ("| data | 100 problems |", "| steps | 5 |", "| hardware | a \\| b |"):
        assert line in text
    assert "## Scores" in text and "| GB | 2/10 |" in text and "| width | 12 |" in text


@pytest.mark.parametrize("fact", FACTS)
def test_a_card_without_a_fact_is_refused(policy, tmp_path, fact):
    with pytest.raises(WeightsError, match=fact):
        save(
            tmp_path / "x.safetensors",
            NETWORK,
            policy.parameters,
            {k: v for k, v in CARD.items() if k != fact},
        )
    assert not list(tmp_path.iterdir())


def test_half_the_storage(policy, file, tmp_path):
    half = tmp_path / "half.safetensors"
    save(half, NETWORK, policy.parameters, CARD, storage="float16")
    assert half.stat().st_size < 0.75 * file.stat().st_size
    found = load(half)
    assert {leaf.dtype for leaf in jax.tree.leaves(found.parameters)} == {jnp.dtype("float32")}
    jax.tree.map(
        lambda a, b: np.testing.assert_allclose(a, b, atol=1e-3),
        found.parameters,
        policy.parameters,
    )


def test_saving_what_cannot_be_loaded_is_refused(policy, tmp_path):
    path = tmp_path / "x.safetensors"
    wrong = jax.tree.map(lambda leaf: jnp.full_like(leaf, jnp.nan), policy.parameters)
    with pytest.raises(WeightsError, match="finite"):
        save(path, NETWORK, wrong, CARD)
    with pytest.raises(WeightsError, match="storage"):
        save(path, NETWORK, policy.parameters, CARD, storage="int8")
    with pytest.raises(WeightsError, match="safetensors"):
        save(tmp_path / "x.pkl", NETWORK, policy.parameters, CARD)
    with pytest.raises(WeightsError, match="missing"):
        save(path, NETWORK, {"out": policy.parameters["out"]}, CARD)
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_weights_are_for_one_arm(file, tmp_path):
    arm = toy_arm(tmp_path)
    with pytest.raises(WeightsError, match=r"shape .*; its sizes ask for .* for toy \(4 joints\)"):
        load(file, robot=arm)
    own = tmp_path / "toy.safetensors"
    save(own, ImpactFormat(TINY, arm), initial(TINY, robot=arm), CARD)
    found = load(own, robot=arm)
    seen = nothing_seen(observation_spec(arm))
    assert jax.eval_shape(lambda seen: found.act(seen, (), None)[0], seen).shape == (4,)
    with pytest.raises(WeightsError, match="its sizes ask for"):
        load(own)


def test_no_such_name_or_file(tmp_path):
    with pytest.raises(WeightsError, match=r"no weights 'nothing'; shipped: .*\.safetensors"):
        load("nothing")
    assert "no such file" in refused(tmp_path / "absent.safetensors")


@pytest.mark.parametrize("share", [0.0, 0.001, 0.3, 0.99])
def test_a_truncated_file_is_refused(file, share):
    content = file.read_bytes()
    file.write_bytes(content[: int(share * len(content))])
    assert "not a whole safetensors file" in refused(file)


def test_a_pickle_is_refused(tmp_path):
    path = tmp_path / "x.safetensors"
    path.write_bytes(b"\x80\x04\x95" + bytes(100))
    assert "not a whole safetensors file" in refused(path)


def test_a_changed_number_is_refused(file):
    content = bytearray(file.read_bytes())
    content[-3] ^= 1
    file.write_bytes(content)
    assert "damaged" in refused(file)


@pytest.mark.parametrize("stated", ["drpbench-impact-99", "my_package.my_module:Mine"])
def test_an_unknown_network_lists_those_there_are(file, stated):
    message = refused(rewritten(file, format=stated))
    assert f"got format {stated}" in message
    assert "unknown network" in message and "impact (drpbench-impact-1)" in message


def test_a_file_of_no_network_is_refused(file):
    save_file({"a": np.zeros(3, np.float32)}, file)
    assert "unknown network" in refused(file) and "format none" in refused(file)
    with pytest.raises(WeightsError, match="no model card"):
        weights.card(file)


@dataclass(frozen=True)
class Pair(Network):
    """A network of another kind: its tree holds a list, its sizes a tuple."""

    widths: tuple[int, ...] = (2, 3)

    def shapes(self):
        return {"layers": [jax.ShapeDtypeStruct((width,), "float32") for width in self.widths]}

    def policy(self, parameters, weights=""):
        return Impact(parameters, TINY, weights)  # any policy that keeps them


def test_a_network_of_another_kind_comes_back_whole(tmp_path):
    path, network = tmp_path / "pair.safetensors", Pair((4, 1))
    parameters = {"layers": [jnp.arange(4.0), jnp.ones(1)]}
    digest = save(path, network, parameters, CARD)
    assert set(load_file(path)) == {"layers.0", "layers.1"}
    assert "Pair with 5 parameters." in path.with_suffix(".md").read_text()
    found = load(path, {"pair": Pair})
    assert found.weights == digest == weights.checksum(path)
    jax.tree.map(np.testing.assert_array_equal, found.parameters, parameters)
    with pytest.raises(
        WeightsError, match=r"expected impact \(drpbench-impact-1\), .*, got format .*:Pair"
    ):
        load(path)
    rewritten(path, size=json.dumps({"depth": 3}))
    with pytest.raises(WeightsError, match="not sizes of Pair: expected widths, got depth"):
        load(path, {"pair": Pair})


def test_a_file_from_before_feelers_is_of_a_network_without(file):
    sizes = {name: value for name, value in asdict(TINY).items() if "feeler" not in name}
    rewritten(file, size=json.dumps(sizes))
    assert load(file).size == TINY and TINY.feelers == 0


def test_tensors_that_do_not_fit_are_refused(file):
    tensors = load_file(file)
    content = file.read_bytes()
    less = {name: leaf for name, leaf in tensors.items() if name != "out.kernel"}
    assert "missing, first out.kernel" in refused(rewritten(file, less))
    file.write_bytes(content)
    more = tensors | {"head.bias": np.zeros(3, np.float32)}
    assert "too many, first head.bias" in refused(rewritten(file, more))
    file.write_bytes(content)
    other = tensors | {"out.kernel": np.zeros((3, 7), np.float32)}
    message = refused(rewritten(file, other))
    assert "out.kernel has shape (3, 7)" in message and "(12, 7)" in message


@pytest.mark.parametrize("size", ["", "[]", "{}", '{"width": 12, "depth": 3}'])
def test_sizes_that_are_none_are_refused(file, size):
    assert "not sizes of IMPACT" in refused(rewritten(file, size=size))


@pytest.mark.parametrize(
    ("name", "value", "why"),
    [
        ("heads", 0, "positive"),
        ("width", "wide", ""),
        ("heads", 5, "multiple of heads"),
        ("scene_points", 100, "must divide 2048"),
        ("point_mlp", [8, -1], "positive"),
    ],
)
def test_sizes_that_cannot_be_are_refused(file, name, value, why):
    message = refused(rewritten(file, size=json.dumps(asdict(TINY) | {name: value})))
    assert "not sizes of IMPACT" in message and why in message


def test_every_shipped_file_loads_and_has_its_card():
    for name in weights.shipped():
        policy = load(name)
        text = (weights.FOLDER / f"{name}.md").read_text()
        assert policy.weights in text and set(FACTS) <= set(weights.card(name))


@pytest.mark.slow
def test_the_policy_keeps_the_protocol(file):
    policy = load(file)
    assert isinstance(policy, Policy) and policy.privileged is False
    leaves, form = jax.tree.flatten(policy)
    assert jax.tree.unflatten(form, leaves) == policy
    header = header_parameters(policy)
    assert header["weights"] == policy.weights and header["size.width"] == 12

    q = postures(4)
    points = np.random.default_rng(0).uniform(-0.5, 0.5, (200, 3))
    seen = [observation(a, b, points=points) for a, b in zip(q[:2], q[2:], strict=True)]
    seen = jax.tree.map(lambda *leaves: jnp.stack(leaves), *seen)
    keys = jax.random.split(jax.random.key(0), 2)
    traced = []

    @jit
    def act(policy, seen, keys):
        traced.append(1)
        return jax.vmap(lambda o, k: policy.act(o, policy.init(o), k))(seen, keys)

    target, carry = act(policy, seen, keys)
    assert target.shape == (2, 7) and target.dtype == jnp.float32 and carry == ()
    joints, goal = seen.joint_position, seen.goal_joints
    clouds = (seen.scene_points, seen.scene_mask, seen.robot_points)
    chunk = jit(partial(apply, TINY))(policy.parameters, *clouds, joints, goal)
    np.testing.assert_allclose(target, commanded(chunk, joints, goal), atol=1e-5)
    # Loaded again, it is the same program.
    np.testing.assert_array_equal(act(load(file), seen, keys)[0], target)
    assert len(traced) == 1
