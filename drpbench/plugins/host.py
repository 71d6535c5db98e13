"""Host policies at work: called outside jit, a batch of instances at a time, under a time limit.

    class MyPolicy:
        arrays = "torch"                      # what it is handed; or "numpy" (the default), "jax"

        def reset(self, observation): ...     # episodes begin: B of them, seen for the first time
        def act(self, observation): ...       # joint position targets (B, J) [rad]

What it raises, answers wrongly or never answers fails the batch it happened in, with the reason in
each row's status. docs/your-policy.md says all of it in words.
"""

import contextlib
import queue
import sys
import threading
import traceback
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import jax
import numpy as np
from jaxtyping import PRNGKeyArray

from drpbench.contract import OBSERVED, HostObservation, HostPolicy, Observation, Policy

from .errors import PolicyError, told

TIME_LIMIT = 10.0  # [s] for one control step of a batch
RESET_SHARE = 10.0  # `reset` may take so many times the limit: it is where models warm up


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Shown:
    """Stands for a host policy inside jit: answers what it is shown, whatever lies over it."""

    privileged: bool = field(default=False, metadata={"static": True})

    def init(self, observation: Observation) -> tuple[()]:
        return ()

    def act(
        self, observation: Observation, carry: tuple[()], key: PRNGKeyArray | None
    ) -> tuple[Any, tuple[()]]:
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
        time_limit: float | None = TIME_LIMIT,
    ):
        """`build` makes another one once `policy` hung; `over` puts JAX policies over it that
        change what it sees (DCP-RMP); `time_limit` [s] is for one control step; a policy
        that keeps its own time has none. Raises PolicyError.
        """
        self.policy: HostPolicy | None = policy
        self._build, self.time_limit = build, time_limit
        self.about = str(getattr(policy, "about", ""))
        """What the policy says that it is, for a result's header."""
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
        """Tells the policy that `count` episodes begin. Raises Failed; PolicyError where a policy
        that hung cannot be made anew."""
        if self.policy is None:
            self.policy = self._build()
        limit = self.time_limit
        self._call("reset", observation, count, None if limit is None else RESET_SHARE * limit)

    def act(self, observation: Observation, count: int) -> np.ndarray:
        """The policy's targets (count, J) float32, numbers or not. Raises Failed."""
        answer = self._call("act", observation, count, self.time_limit)
        return answered(answer, count, observation.joint_position.shape[-1])

    def failures(self, count: int) -> tuple[str, ...]:
        """Why the policy gives up each of `count` episodes; "" where it does not. Raises Failed."""
        given = tuple(str(one) for one in getattr(self.policy, "failures", ())) or ("",) * count
        if len(given) != count:
            raise Failed(f"failures: {len(given)} of them for {count} episodes")
        return given

    def _call(self, method: str, observation: Observation, count: int, limit: float | None) -> Any:
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

    def __init__(self) -> None:
        self._calls: queue.SimpleQueue = queue.SimpleQueue()
        self._answers: queue.SimpleQueue = queue.SimpleQueue()
        # The thread holds the queues alone, so that it ends with the worker.
        threading.Thread(target=_serve, args=(self._calls, self._answers), daemon=True).start()

    def call(
        self,
        function: Callable,
        argument: HostObservation,
        context: Callable[[], contextlib.AbstractContextManager],
        limit: float | None,
    ) -> tuple[Any, BaseException | None]:
        """What the function answers or raises. Raises queue.Empty once the limit [s], if there is
        one, has passed."""
        self._calls.put((function, argument, context))
        return self._answers.get(timeout=limit)

    def dismiss(self) -> None:
        self._calls.put(None)

    def __del__(self) -> None:
        self.dismiss()


def _serve(calls: queue.SimpleQueue, answers: queue.SimpleQueue) -> None:
    while (call := calls.get()) is not None:
        function, argument, context = call
        try:
            with context():
                answers.put((function(argument), None))
        except BaseException as error:
            answers.put((None, error))


def answered(answer: Any, count: int, joints: int) -> np.ndarray:
    """An answer as (count, joints) float32. Raises Failed for what is none."""
    kind = type(answer).__name__
    try:
        if hasattr(answer, "detach"):  # a tensor, on whatever device
            answer = answer.detach().cpu()
            # As numbers of any precision, but never a truth as 0 and 1 rad.
            said = str(getattr(answer, "dtype", ""))
            if "bool" in said or "complex" in said:
                raise Failed(f"answer: {kind} of {said}, not numbers")
            answer = np.from_dlpack(answer.float())
        targets = np.asarray(answer)
    except Failed:
        raise
    except Exception as error:
        raise Failed(f"answer: {kind} is no array: {told(error)}") from None
    if targets.dtype.kind not in "fiu":
        raise Failed(f"answer: {kind} of {targets.dtype}, not numbers")
    if targets.shape != (count, joints):
        raise Failed(f"shape: {targets.shape}, not {(count, joints)}")
    with np.errstate(over="ignore"):
        return targets.astype(np.float32)


_Handed = tuple[HostObservation, Callable[[], contextlib.AbstractContextManager]]


def _as_numpy(observation: Observation, count: int, policy: Any) -> _Handed:
    return _each(lambda leaf: np.array(np.asarray(leaf)[:count]), observation), _nothing


def _as_jax(observation: Observation, count: int, policy: Any) -> _Handed:
    return _each(lambda leaf: leaf[:count], observation), _nothing


def _as_torch(observation: Observation, count: int, policy: Any) -> _Handed:
    """Tensors: views of JAX's own buffers where both sit on one device, moved to `policy.device` if
    it has one; and without gradients, which nobody would collect."""
    torch = _torch()
    device = getattr(policy, "device", None)

    def tensor(leaf: jax.Array) -> Any:
        if leaf.dtype == bool:  # which not every PyTorch reads by DLPack
            return tensor(leaf.view(np.uint8)).view(torch.bool)
        if all(device.platform == "cpu" for device in leaf.devices()) or torch.cuda.is_available():
            found = torch.from_dlpack(leaf)[:count]
        else:
            found = torch.from_numpy(np.array(np.asarray(leaf)[:count]))
        return found if device is None else found.to(device)

    return _each(tensor, observation), torch.no_grad


def _each(convert: Callable[[jax.Array], Any], observation: Observation) -> HostObservation:
    return HostObservation(
        obstacles=jax.tree.map(convert, observation.obstacles),
        **{name: convert(getattr(observation, name)) for name in OBSERVED},
    )


_nothing = contextlib.nullcontext
# How an observation of more lanes than that is handed to a policy, and what it is called in.
HANDED = {"numpy": _as_numpy, "torch": _as_torch, "jax": _as_jax}


def _torch() -> Any:
    try:
        import torch
    except ImportError:
        raise PolicyError(
            "this policy asks for PyTorch tensors, and PyTorch is not installed: pip install "
            '"drpbench[torch]"'
        ) from None
    return torch
