"""Host policies: ordinary Python objects, stepped outside jit, a batch of instances at a time.

    class MyPolicy:
        arrays = "torch"                      # what it is handed: "numpy" (the default), "torch" or "jax"

        def reset(self, observation): ...     # episodes begin: B of them, seen for the first time
        def act(self, observation): ...       # joint position targets (B, 7) [rad]

What it raises, answers wrongly or never answers fails the batch it happened in, with the reason in each
row's status. docs/your-policy.md says all of it in words.
"""

import contextlib
import queue
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, Protocol

import jax
import numpy as np

from drpbench.contract import Observation, Policy

from .errors import PolicyError, told

TIME_LIMIT = 10.0  # [s] for one control step of a batch
RESET_SHARE = 10.0  # `reset` may take so many times the limit: it is where models warm up


@dataclass
class HostObservation:
    """What B instances show, in the world frame (the arm's base), as arrays of the policy's own kind.

    They are the policy's to keep and to write on.
    """

    joint_position: Any  # (B, 7) [rad]
    joint_velocity: Any  # (B, 7) [rad/s]
    goal_joints: Any  # (B, 7) [rad]
    goal_position: Any  # (B, 3) [m], of the frame `grip`
    goal_quaternion: Any  # (B, 4) wxyz
    scene_points: Any  # (B, 2048, 3) [m], the same points of the same surfaces throughout
    scene_mask: Any  # (B, 2048) bool, false where there is no point
    robot_points: Any  # (B, 256, 3) [m], on the arm's outer surface
    obstacles: Any = None  # every obstacle as it is, for a privileged policy only


class HostPolicy(Protocol):
    """A policy that is stepped outside jit. `arrays` and `privileged` may be left out."""

    def reset(self, observation: HostObservation) -> None:
        """B episodes begin, and this is what they show. Whatever was kept of others is void."""
        ...

    def act(self, observation: HostObservation) -> Any:
        """Absolute joint position targets (B, 7) [rad] for the next control step (1/60 s)."""
        ...


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Shown:
    """Stands for a host policy inside jit: answers what it is shown, whatever lies over it."""

    privileged: bool = field(default=False, metadata={"static": True})

    def init(self, observation: Observation):
        return ()

    def act(self, observation: Observation, carry, key):
        return observation, carry


class Failed(Exception):
    """The policy gave no answer; the message is what its rows' status says."""


class Hosted:
    """A host policy, kept at arm's length: called in a thread of its own, under a time limit."""

    def __init__(
        self,
        policy: HostPolicy,
        build: Callable[[], HostPolicy],
        over: Callable[[Policy], Policy] = lambda policy: policy,
        time_limit: float = TIME_LIMIT,
    ):
        """`build` makes another one once `policy` hung; `over` puts JAX policies over it that change what
        it sees (DCP-RMP); `time_limit` [s] is for one control step. Raises PolicyError."""
        self.policy, self._build, self.time_limit = policy, build, time_limit
        self.arrays = getattr(policy, "arrays", "numpy")
        if self.arrays not in HANDED:
            raise PolicyError(
                f"{type(policy).__name__}: arrays = {self.arrays!r}; there are: {', '.join(HANDED)}"
            )
        if self.arrays == "torch":
            _torch()
        self.shown = over(Shown(getattr(policy, "privileged", False)))
        self._worker: _Worker | None = None
        self._told = False

    @property
    def privileged(self) -> bool:
        return self.shown.privileged

    def reset(self, observation: Observation, count: int) -> None:
        """Tells the policy that `count` episodes begin. Raises Failed; PolicyError where a policy that
        hung cannot be made anew."""
        if self.policy is None:
            self.policy = self._build()
        self._call("reset", observation, count, RESET_SHARE * self.time_limit)

    def act(self, observation: Observation, count: int) -> np.ndarray:
        """The policy's targets (count, 7) float32, numbers or not. Raises Failed."""
        return answered(self._call("act", observation, count, self.time_limit), count)

    def _call(self, method: str, observation: Observation, count: int, limit: float) -> Any:
        handed, context = HANDED[self.arrays](observation, count, self.policy)
        if self._worker is None:
            self._worker = _Worker()
        try:
            answer, error = self._worker.call(getattr(self.policy, method), handed, context, limit)
        except queue.Empty:
            # The thread is lost with the policy it is in; neither is asked again.
            self._worker.dismiss()
            self._worker = self.policy = None
            raise Failed(f"timeout: {method} took longer than {limit:g} s") from None
        if isinstance(error, PolicyError | Failed):
            raise error
        if error is not None:
            if not self._told:  # the rows have one line of it; its author wants to see where
                traceback.print_exception(error, file=sys.stderr)
                self._told = True
            raise Failed(f"raised: {told(error)}")
        return answer


class _Worker:
    """A daemon thread: one that never comes back does not keep the program from ending."""

    def __init__(self):
        self._calls: queue.SimpleQueue = queue.SimpleQueue()
        self._answers: queue.SimpleQueue = queue.SimpleQueue()
        # The thread holds the queues alone, so that it ends with the worker.
        threading.Thread(target=_serve, args=(self._calls, self._answers), daemon=True).start()

    def call(self, function, argument, context, limit: float) -> tuple[Any, BaseException | None]:
        """What the function answers or raises. Raises queue.Empty once the limit [s] has passed."""
        self._calls.put((function, argument, context))
        return self._answers.get(timeout=limit)

    def dismiss(self) -> None:
        self._calls.put(None)

    __del__ = dismiss


def _serve(calls: queue.SimpleQueue, answers: queue.SimpleQueue) -> None:
    while (call := calls.get()) is not None:
        function, argument, context = call
        try:
            with context():
                answers.put((function(argument), None))
        except BaseException as error:
            answers.put((None, error))


def answered(answer: Any, count: int) -> np.ndarray:
    """An answer as (count, 7) float32. Raises Failed for what is none."""
    if hasattr(answer, "detach"):  # a tensor, on whatever device
        answer = np.from_dlpack(answer.detach().cpu().float())
    try:
        targets = np.asarray(answer)
    except Exception as error:
        raise Failed(f"answer: {type(answer).__name__} is no array: {told(error)}") from None
    if targets.dtype.kind not in "fiu":
        raise Failed(f"answer: {type(answer).__name__} of {targets.dtype}, not numbers")
    if targets.shape != (count, 7):
        raise Failed(f"shape: {targets.shape}, not {(count, 7)}")
    with np.errstate(over="ignore"):
        return targets.astype(np.float32)


def _as_numpy(observation: Observation, count: int, policy: Any):
    return _each(lambda leaf: np.array(np.asarray(leaf)[:count]), observation), _nothing


def _as_jax(observation: Observation, count: int, policy: Any):
    return _each(lambda leaf: leaf[:count], observation), _nothing


def _as_torch(observation: Observation, count: int, policy: Any):
    """Tensors: views of JAX's own buffers where both sit on one device, moved to `policy.device` if it
    has one; and without gradients, which nobody would collect."""
    torch = _torch()
    device = getattr(policy, "device", None)

    def tensor(leaf: jax.Array) -> Any:
        if leaf.dtype == bool:  # which not every PyTorch reads by DLPack
            return tensor(leaf.view(np.uint8)).view(torch.bool)
        if leaf.device.platform == "cpu" or torch.cuda.is_available():
            found = torch.from_dlpack(leaf)[:count]
        else:
            found = torch.from_numpy(np.array(np.asarray(leaf)[:count]))
        return found if device is None else found.to(device)

    return _each(tensor, observation), torch.no_grad


def _each(convert: Callable[[jax.Array], Any], observation: Observation) -> HostObservation:
    return HostObservation(
        **{
            of.name: jax.tree.map(convert, getattr(observation, of.name))
            for of in fields(HostObservation)
        }
    )


_nothing = contextlib.nullcontext
# How an observation of more lanes than that is handed to a policy, and what it is called in.
HANDED = {"numpy": _as_numpy, "torch": _as_torch, "jax": _as_jax}


def _torch() -> Any:
    try:
        import torch
    except ImportError:
        raise PolicyError(
            'this policy asks for PyTorch tensors, and PyTorch is not installed: pip install "drpbench[torch]"'
        ) from None
    return torch
