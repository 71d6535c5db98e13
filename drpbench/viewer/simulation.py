"""One world as it goes on: a policy in a task, with things moved in between. Knows of no page.

Untouched, an episode here is the one that `drpbench run` judges: the same functions, keys and order, in a
program of batch 1 (which may round differently in the seventh digit).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import (
    CONTROL_PERIOD,
    CONTROL_STEPS,
    REACH_ORIENTATION,
    REACH_POSITION,
    Policy,
)
from drpbench.envs import TASKS, State, World
from drpbench.planning.pose_goals import nearest_goal
from drpbench.plugins.host import Failed, Hosted
from drpbench.policies import DcpRmp
from drpbench.problems import TaskProblems
from drpbench.robot import PANDA
from drpbench.rollout.batch import instance_key, record

from .furniture import Furniture, with_room
from .moment import Moment, moment

FOLLOW_SPEED = 1.0
"""[m/s] at which what is dragged follows, while the world runs. A jump into the arm is no test of it: at this
speed a point moves less in a control step than DCP-RMP takes for a point that has just appeared."""
_BOX = (0.06, 0.06, 0.06)  # [m] half extents of an added box
_BOX_PLACES = np.array(
    [(0.45, 0.45, 0.3), (0.45, -0.45, 0.3), (0.65, 0.0, 0.75), (0.3, 0.5, 0.7), (0.3, -0.5, 0.7)]
)  # [m] where they may be put


@dataclass(frozen=True)
class Verdict:
    """What a result's row would say, had the episode ended now."""

    steps: int
    """Control steps judged; an episode has CONTROL_STEPS."""
    reached: bool
    collided: bool
    first_collision_step: int | None
    first_collision_link: str | None
    finite: bool
    valid: bool
    """GB: whether the goal has been blocked. An episode in which it never was is not counted."""

    @property
    def success(self) -> bool:
        return self.reached and not self.collided


class Simulation:
    """A policy in one task of the benchmark. `open` a problem, then `step`."""

    def __init__(self, task: str, policy: Policy | Hosted, problems: TaskProblems, seed: int = 0):
        self.task, self.problems, self.seed = TASKS[task], problems, seed
        self.world = World(self.task)
        self._hosted = policy if isinstance(policy, Hosted) else None
        self._policy = policy.shown if self._hosted else policy
        self._reset, self._solve = jit(self._reset_world), jit(nearest_goal)
        self._act, self._step = jit(self._act_once), jit(self._step_world)
        self._advance, self._see = jit(self._act_and_step), jit(self._look)
        self.reacts = isinstance(self._policy, DcpRmp)
        """Whether there is a modified goal to be seen."""
        self.id = 0

    def open(self, id: int) -> None:
        """Begins the episode of a problem. In a task with a rehearsal (SAO), with that.

        Raises ProblemSetError for a number that is not there.
        """
        self.problems.require([id])
        self.id, self._path = id, []
        self._first = with_room(
            jax.tree.map(lambda leaf: np.asarray(leaf)[0, ...], self.problems.take([id]))
        )
        self.rehearsing = self.task.rehearsed
        self._begin()

    def compile(self, id: int) -> Iterator[str]:
        """Opens a problem and has everything compiled that will be used; says what is ready."""
        self.open(id)
        yield "the scene"
        self.look()
        yield "the picture"
        self.step()
        yield "the world with its policy"
        problem = self._state.problem
        self._nearest_goal(problem.goal_position, problem.goal_quaternion)
        yield "inverse kinematics"
        self.open(id)

    def reset(self) -> None:
        """The same problem from its start, as it was; a rehearsal that is done is not done again."""
        if self.rehearsing:
            self._path = []
        self._begin()

    def _begin(self) -> None:
        state, self._carry, shown = self._reset(self._policy, self._first)
        if self.task.rehearsed and not self.rehearsing:
            path = jnp.asarray(np.stack(self._path))
            state = replace(state, memory=self.task.second_pass(state.memory, path))
        self._state: State = state
        self.furniture = Furniture(state, instance_key(self.seed, self.task.name, self.id, 0))
        self.clock, self.edited, self.failure = 0, False, ""
        self._finite, self._collision, self._reached = True, None, False
        self.touching: str | None = None
        """The link that touched something in the last control step."""
        self._valid = bool(self.task.valid(state.memory))
        self._wanted: dict[tuple[str, int], tuple[np.ndarray, bool]] = {}
        if self._hosted:
            self._ask(self._hosted.reset, shown)

    # -- the course of time --

    def step(self) -> None:
        """One control step, 1/60 s; what is being dragged follows. A rehearsal ends in a new beginning."""
        clock = np.int32(self.clock)
        if self._hosted:
            shown, self._carry = self._act(self._policy, self._state, self._carry, clock)
            target = self._ask(self._hosted.act, shown)
            target = np.full(7, np.nan, np.float32) if target is None else target[0]
            self._state, step = self._step(self._state, target, clock)
        else:
            self._state, self._carry, step = self._advance(
                self._policy, self._state, self._carry, clock
            )
        self.clock += 1
        step = jax.device_get(step)
        link = PANDA.link_names[PANDA.moving_spheres.link[step["sphere"]]]
        self.touching = link if step["clearance"] < 0.0 else None
        if self.clock <= CONTROL_STEPS:
            self._judge(step)
        # Last, so that what is seen now is what the policy will be shown.
        self._follow(FOLLOW_SPEED * CONTROL_PERIOD)
        if self.rehearsing and self.clock == CONTROL_STEPS:
            self.rehearsing = False
            self._begin()

    def _judge(self, step: dict[str, np.ndarray]) -> None:
        if self.rehearsing:
            self._path.append(step["grip_position"])
        self._finite &= bool(step["finite"]) and not self.failure
        near = step["position_error"] < REACH_POSITION
        self._reached = bool(near and step["orientation_error"] < REACH_ORIENTATION)
        if self.touching and self._collision is None:
            self._collision = (self.clock - 1, self.touching)
        self._valid = bool(self.task.valid(self._state.memory))

    @property
    def verdict(self) -> Verdict:
        """Of the episode so far; it stays what it is once CONTROL_STEPS have passed."""
        step, link = self._collision or (None, None)
        return Verdict(
            steps=min(self.clock, CONTROL_STEPS),
            reached=self._reached and self._finite,
            collided=self._collision is not None,
            first_collision_step=step,
            first_collision_link=link,
            finite=self._finite,
            valid=self._valid,
        )

    def _ask(self, question, shown) -> np.ndarray | None:
        """A host policy's answer; None once it has failed in this episode."""
        if not self.failure:
            try:
                return question(shown, 1)
            except Failed as failed:
                self.failure = str(failed)
        return None

    # -- things moved --

    def move(
        self, what: str, index: int, position: np.ndarray, hold: bool = False, at_once: bool = True
    ) -> None:
        """Puts a "piece" of the furniture, or a "box" of the task's own, at a position [m]; or lets it follow
        with time. A box that drifts is held there while `hold`, and drifts on from there."""
        if self.rehearsing or not self._movable(what)[index]:
            return
        self._wanted[what, index] = (np.asarray(position, np.float32), hold)
        self.edited = True
        if at_once:
            self._follow(math.inf)

    def _movable(self, what: str) -> np.ndarray:
        return self.furniture.movable if what == "piece" else np.asarray(self._state.movers.active)

    def _follow(self, most: float) -> None:
        """Brings what is being dragged nearer to where it is wanted, by `most` [m]."""
        if not self._wanted:
            return
        boxes = np.array(self._state.movers.position)
        for (what, index), (place, hold) in list(self._wanted.items()):
            if not self._movable(what)[index]:
                del self._wanted[what, index]
                continue
            places = boxes if what == "box" else self.furniture.position
            offset = place - places[index]
            length = float(np.linalg.norm(offset))
            places[index] += offset * min(1.0, most / max(length, 1e-9))
            if length <= most and not hold:
                del self._wanted[what, index]
        movers = replace(self._state.movers, position=jnp.asarray(boxes))
        self._state = self.furniture.put_into(replace(self._state, movers=movers))

    def add_box(self) -> int | None:
        """An upright cube more, of 12 cm, away from the arm and its goal: its piece, or None where there are enough."""
        if self.rehearsing:
            return None
        there = self.furniture.position[self.furniture.added][
            self.furniture.present[self.furniture.added]
        ]
        moment = self.look()
        others = np.concatenate([moment.arm[0], moment.goal[0], there])
        gaps = np.linalg.norm(_BOX_PLACES[:, None] - others, axis=-1).min(axis=1)
        piece = self.furniture.add(np.array(_BOX), _BOX_PLACES[np.argmax(gaps)])
        self._changed()
        return piece

    def remove_boxes(self) -> None:
        """Takes the added boxes away."""
        for piece in self.furniture.added:
            self._wanted.pop(("piece", piece), None)
        self.furniture.remove_added()
        self._changed()

    def _changed(self) -> None:
        self.edited = True
        self._state = self.furniture.put_into(self._state)

    def move_goal(self, position: np.ndarray, quaternion: np.ndarray) -> bool:
        """Asks for another pose of `grip` ([m], wxyz). Without a solution the goal stays: False.

        Of the solutions that touch no furniture, the nearest to the goal there is.
        """
        if self.rehearsing:
            return False
        problem = self._state.problem
        place = jnp.asarray(position, jnp.float32)
        turn = jnp.asarray(quaternion / np.linalg.norm(quaternion), jnp.float32)
        goal, found = self._nearest_goal(place, turn)
        if found:
            self.edited = True
            problem = replace(problem, goal=goal, goal_position=place, goal_quaternion=turn)
            self._state = replace(self._state, problem=problem)
        return bool(found)

    @property
    def joint_position(self) -> jax.Array:
        """(7,) [rad]."""
        return self._state.joint_position

    @property
    def goal_joints(self) -> jax.Array:
        """The goal as joints (7,) [rad]."""
        return jnp.asarray(self._state.problem.goal)

    def _nearest_goal(self, position: jax.Array, quaternion: jax.Array):
        problem = self._state.problem
        return self._solve(problem.obstacles, problem.goal, position, quaternion, jax.random.key(0))

    # -- what there is to see --

    def look(self) -> Moment:
        """The world as it is now."""
        return jax.device_get(self._see(self._policy, self._state, self._carry))

    # -- compiled --

    def _reset_world(self, policy: Policy, problem):
        key = instance_key(self.seed, self.task.name, problem.id, 0)
        state = self.world.reset(jax.tree.map(jnp.asarray, problem), key)
        observation = self.world.observe(state, policy.privileged)
        return state, policy.init(observation), _batch_of_one(observation)

    def _act_and_step(self, policy: Policy, state: State, carry: Any, clock: jax.Array):
        target, carry = self._answer(policy, state, carry, clock)
        state, step = self._step_world(state, target, clock)
        return state, carry, step

    def _answer(self, policy: Policy, state: State, carry: Any, clock: jax.Array):
        key = instance_key(self.seed, self.task.name, state.problem.id, 1)
        observation = self.world.observe(state, policy.privileged)
        return policy.act(observation, carry, jax.random.fold_in(key, clock))

    def _act_once(self, policy: Policy, state: State, carry: Any, clock: jax.Array):
        shown, carry = self._answer(policy, state, carry, clock)
        return _batch_of_one(shown), carry

    def _step_world(self, state: State, target: jax.Array, clock: jax.Array):
        state, events = self.world.step(state, target, clock)
        return state, record(state, events)

    def _look(self, policy: Policy, state: State, carry: Any) -> Moment:
        return moment(self.world, policy, state, carry)


def _batch_of_one(observation):
    return jax.tree.map(lambda leaf: leaf[None], observation)
