"""Weights on disk: a safetensors file, and beside it a model card that is generated from its facts.

The file's metadata hold a format that names the network, the network's sizes and the card's facts
as JSON, and a SHA-256 of the numbers, so a file is whole by itself. Nothing is ever unpickled, and
nothing is imported because a file names it.
"""

import hashlib
import json
import os
import tempfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from safetensors import SafetensorError, safe_open
from safetensors.numpy import save as serialised

from drpbench.contract import Policy
from drpbench.errors import DrpbenchError
from drpbench.robot import PANDA, Robot

from .networks.impact_format import ImpactFormat
from .networks.lstm_gmm_format import LstmGmmFormat
from .networks.network import Network

FOLDER = Path(__file__).parent / "weights"
NETWORKS: dict[str, type[Network]] = {"impact": ImpactFormat, "neuralmp": LstmGmmFormat}
"""Networks whose files are known without being named."""
STORAGE = ("float32", "float16")
FACTS = ("data", "steps", "hardware", "scores", "licence")
"""What a model card must say."""


class WeightsError(DrpbenchError):
    """A file of weights that is absent, damaged or of another network; the message is one line."""


def shipped() -> list[str]:
    """Names of the weights that come with the package."""
    return sorted(path.stem for path in FOLDER.glob("*.safetensors"))


def save(
    path: Path | str,
    network: Network,
    parameters: Any,
    card: Mapping[str, Any],
    storage: str = "float32",
) -> str:
    """Writes the network's parameters, and the card beside them as Markdown; returns their SHA-256.

    `card` must hold FACTS, and may hold more; values are whatever JSON holds. `storage` "float16"
    halves the file; parameters are float32 again when loaded. The file appears whole or not at all.
    Raises WeightsError for a card without its facts, or parameters that are not of the network's
    size.
    """
    path = Path(path)
    if path.suffix != ".safetensors":
        raise WeightsError(f"{path}: weights are saved as a .safetensors file")
    if missing := [fact for fact in FACTS if fact not in card]:
        raise WeightsError(f"{path}: the model card does not say: {', '.join(missing)}")
    if storage not in STORAGE:
        raise WeightsError(f"{path}: storage is {' or '.join(STORAGE)}, not {storage!r}")
    found = _named(parameters)
    _check(path, {name: leaf.shape for name, leaf in found.items()}, network)
    tensors = {name: np.asarray(leaf, storage) for name, leaf in found.items()}
    if infinite := [name for name, leaf in tensors.items() if not np.isfinite(leaf).all()]:
        raise WeightsError(f"{path}: not finite as {storage}: {infinite[0]}")
    digest = _digest(tensors)
    metadata = {
        "format": network.format(),
        "size": json.dumps(network.settings()),
        "card": json.dumps(dict(card)),
        "sha256": digest,
    }
    path.parent.mkdir(parents=True, exist_ok=True)
    _write(path, serialised(tensors, metadata=metadata))
    _write(path.with_suffix(".md"), _markdown(path.stem, network, card, digest).encode())
    return digest


def load(
    name: str | Path,
    networks: Mapping[str, type[Network]] = NETWORKS,
    robot: Robot = PANDA,
) -> Policy:
    """The shipped policy of that name, or that of a file, a path that ends in `.safetensors`.

    `networks` are those that the file may be of, by the names that a user knows them by. Raises
    WeightsError, also where the network is one for another arm than `robot`: one line that names
    the file, what is wrong and what would be right.
    """
    network, parameters, digest = load_parameters(name, networks, robot)
    return network.policy(parameters, digest)


def load_parameters(
    name: str | Path,
    networks: Mapping[str, type[Network]] = NETWORKS,
    robot: Robot = PANDA,
) -> tuple[Network, Any, str]:
    """The network of that name or file, its parameters, and their SHA-256; as `load`."""
    path = _find(name)
    metadata, tensors = _read(path)
    kind = _kind(path, metadata, networks)
    try:
        network = kind.from_settings(json.loads(metadata.get("size", "")), robot)
    except (ValueError, TypeError, AttributeError) as error:
        raise WeightsError(f"{path}: not sizes of {kind.title()}: {_line(error)}") from None
    _check(path, {key: leaf.shape for key, leaf in tensors.items()}, network)
    if _digest(tensors) != metadata.get("sha256"):
        raise WeightsError(
            f"{path}: damaged: its numbers are not those that were saved; copy it anew"
        )
    parameters = jax.tree_util.tree_map_with_path(
        lambda keys, _: jnp.asarray(tensors[_name(keys)], jnp.float32), network.shapes()
    )
    return network, parameters, metadata["sha256"]


def card(name: str | Path) -> dict[str, Any]:
    """The facts of a file's model card. Raises WeightsError as `load` does."""
    path = _find(name)
    metadata, _ = _read(path)
    if "card" not in metadata:
        raise WeightsError(f"{path}: not a file of drpbench train: it has no model card")
    return json.loads(metadata["card"])


def checksum(name: str | Path) -> str:
    """The SHA-256 of a file's numbers, as the file states it. Raises WeightsError as `load`
    does."""
    metadata, _ = _read(_find(name))
    return metadata.get("sha256", "")


def _find(name: str | Path) -> Path:
    if str(name) in shipped():
        return FOLDER / f"{name}.safetensors"
    path = Path(name)
    if path.suffix != ".safetensors":
        known = ", ".join(shipped()) or "none"
        raise WeightsError(
            f"no weights {str(name)!r}; shipped: {known}; or give the path of a .safetensors file"
        )
    if not path.is_file():
        raise WeightsError(f"{path}: no such file")
    return path


def _read(path: Path) -> tuple[dict[str, str], dict[str, np.ndarray]]:
    try:
        with safe_open(path, framework="numpy") as file:
            metadata = file.metadata() or {}
            tensors = {name: file.get_tensor(name) for name in file.keys()}  # noqa: SIM118
    except (SafetensorError, OSError, TypeError, ValueError) as error:
        raise WeightsError(
            f"{path}: not a whole safetensors file ({_line(error)}); copy it anew"
        ) from None
    return metadata, tensors


def _kind(
    path: Path, metadata: Mapping[str, str], networks: Mapping[str, type[Network]]
) -> type[Network]:
    """The network that the file's format names."""
    by_format = {kind.format(): kind for kind in networks.values()}
    stated = metadata.get("format", "none")
    if stated not in by_format:
        known = ", ".join(f"{name} ({kind.format()})" for name, kind in networks.items())
        raise WeightsError(f"{path}: of an unknown network: expected {known}, got format {stated}")
    return by_format[stated]


def _check(path: Path, found: Mapping[str, tuple], network: Network) -> None:
    """Raises WeightsError unless these are the names and shapes of a network of this size."""
    expected = {name: leaf.shape for name, leaf in _named(network.shapes()).items()}
    missing, unknown = sorted(expected.keys() - found), sorted(found.keys() - expected)
    if missing:
        raise WeightsError(f"{path}: {len(missing)} tensors are missing, first {missing[0]}")
    if unknown:
        raise WeightsError(f"{path}: {len(unknown)} tensors too many, first {unknown[0]}")
    for name, shape in expected.items():
        if found[name] != shape:
            raise WeightsError(
                f"{path}: {name} has shape {found[name]}; its sizes ask for {shape}{_of(network)}"
            )


def _of(network: Network) -> str:
    robot = getattr(network, "robot", PANDA)
    return f" for {robot.name} ({robot.joints} joints)" if robot != PANDA else ""


def _name(keys: tuple[Any, ...]) -> str:
    return jax.tree_util.keystr(keys, simple=True, separator=".")


def _named(parameters: Any) -> dict[str, Any]:
    """Arrays by dotted name, such as `encoder.0.attention.query.kernel`."""
    return {_name(keys): leaf for keys, leaf in jax.tree_util.tree_leaves_with_path(parameters)}


def _digest(tensors: Mapping[str, np.ndarray]) -> str:
    digest = hashlib.sha256()
    for name in sorted(tensors):
        digest.update(f"{name} {tensors[name].dtype} {tensors[name].shape}\n".encode())
        digest.update(np.ascontiguousarray(tensors[name]).tobytes())
    return digest.hexdigest()


def _write(path: Path, content: bytes) -> None:
    handle, temporary = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.")
    try:
        with os.fdopen(handle, "wb") as file:
            file.write(content)
        os.chmod(temporary, 0o644)
        os.replace(temporary, path)
    except BaseException:
        Path(temporary).unlink(missing_ok=True)
        raise


def _line(error: Exception) -> str:
    return " ".join(str(error).split())


def _markdown(name: str, network: Network, card: Mapping[str, Any], digest: str) -> str:
    """The model card: one row a fact; a fact that holds facts is a table of its own."""
    count = sum(int(np.prod(leaf.shape)) for leaf in jax.tree.leaves(network.shapes()))
    simple = {key: value for key, value in card.items() if not isinstance(value, Mapping)}
    lines = [f"# {name}", "", f"{network.title()} with {count:,} parameters.", ""]
    lines += _table(simple | {"sha256 of the numbers": digest})
    for key, value in card.items():
        if isinstance(value, Mapping):
            lines += ["", f"## {key.capitalize()}", "", *_table(value)]
    if sizes := network.settings():
        lines += ["", "## Sizes", "", *_table(sizes)]
    return "\n".join(lines) + "\n"


def _table(facts: Mapping[str, Any]) -> list[str]:
    rows = [f"| {_cell(key)} | {_cell(value)} |" for key, value in facts.items()]
    return ["| | |", "|---|---|", *rows]


def _cell(value: Any) -> str:
    if isinstance(value, (list, tuple)):
        value = ", ".join(map(str, value))
    return " ".join(str(value).replace("|", "\\|").split())
