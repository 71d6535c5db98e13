"""The five tasks as Gymnasium environments; importing this registers them. docs/environments.md has
more.

import gymnasium, drpbench.gym
envs = gymnasium.make_vec("drpbench/FDO-v1", num_envs=64)
env = gymnasium.make("drpbench/FDO-v1")
"""

try:
    import gymnasium
except ImportError:
    raise ImportError(
        "drpbench.gym needs Gymnasium: pip install 'drpbench[gym]'", name="gymnasium"
    ) from None

from drpbench.envs import TASKS

from .normalised import NormalisedObservations as NormalisedObservations
from .normalised import NormalisedVectorObservations as NormalisedVectorObservations
from .normalised import normalised as normalised
from .single import SingleEnv as SingleEnv
from .vector import VectorEnv as VectorEnv

IDS = tuple(f"drpbench/{name}-v1" for name in TASKS)
"""The environments; their version is that of the problem set, drpbench-v1."""

for _id, _task in zip(IDS, TASKS, strict=True):
    gymnasium.register(
        id=_id,
        entry_point="drpbench.gym:SingleEnv",
        vector_entry_point="drpbench.gym:VectorEnv",
        kwargs={"task": _task},
    )
