"""One world as it goes on: a policy in a task, with things moved in between. Knows of no page.

Untouched, an episode here is the one that `drpbench run` judges: the same functions, keys and
order, in a program of batch 1 (which may round differently in the seventh digit).
"""

import math
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from drpbench.compile import jit
from drpbench.contract import Observation, Policy, Problem, Verdict
from drpbench.envs import State, World
from drpbench.planning.pose_goals import nearest_goal
from drpbench.plugins.host import Hosted
from drpbench.policies import DcpRmp
from drpbench.problems import TaskProblems
from drpbench.rollout import instance_key
from drpbench.rollout import step as one_world
from drpbench.rollout.host import Answers
from drpbench.rollout.keys import WORLD
from drpbench.rollout.step import Record

from .furniture import Furniture, with_room
from .moment import Moment, moment

FOLLOW_SPEED = 1.0
"""[m/s] at which what is dragged follows, while the world runs. A jump into the arm is no test of
it: at this speed a point moves less in a control step than DCP-RMP takes for a point that has just
appeared."""
_BOX = (0.06, 0.06, 0.06)  # [m] half extents of an added box
_BOX_PLACES = np.array(
    [(0.45, 0.45, 0.3), (0.45, -0.45, 0.3), (0.65, 0.0, 0.75), (0.3, 0.5, 0.7), (0.3, -0.5, 0.7)]
)  # [m] where they may be put


class Simulation:
    """A policy in a world, and numbered problems of its task. `open` one, then `step`."""

    def __init__(
        self, world: World, policy: Policy | Hosted, problems: TaskProblems, seed: int = 0
    ):
        self.world, self.task, self.problems, self.seed = world, world.task, problems, seed
        self._hosted = policy if isinstance(policy, Hosted) else None
        self._policy = policy.shown if isinstance(policy, Hosted) else policy
        self.reacts = isinstance(self._policy, DcpRmp)
        """Whether there is a modified goal to be seen."""
        self.id = 0

    def open(self, id: int) -> None:
        """Begins the episode of a problem.

        Raises ProblemSetError for a number that is not there.
        """
        self.problems.require([id])
        self.id = id
        problem = with_room(
            jax.tree.map(lambda leaf: np.asarray(leaf)[0, ...], self.problems.take([id]))
        )
        self._first, self._first_carry, self._first_seen = _begin(
            self.world, self._policy, self.seed, problem
        )
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
        """The same problem from its start, as it was."""
        self._begin()

    def _begin(self) -> None:
        self._state, self._carry = self._first, self._first_carry
        key = instance_key(self.seed, self.task.name, self.id, WORLD)
        self.furniture = Furniture(self._state, key)
        self.clock, self.edited = 0, False
        self.verdict = Verdict.begin()
        """Of the episode so far; it stays what it is once its steps have passed."""
        self.first_collision_link: str | None = None
        self.touching: str | None = None
        """The link that touched something in the last control step."""
        self._wanted: dict[tuple[str, int], tuple[np.ndarray, bool]] = {}
        self._answers = Answers(self._hosted, 1) if self._hosted else None
        if self._answers:
            self._answers.reset(jax.tree.map(jnp.copy, self._first_seen))

    @property
    def failure(self) -> str:
        """Why the host policy gave no answer in this episode, if it did not."""
        return self._answers.failure if self._answers else ""

    # -- the course of time --

    def step(self) -> None:
        """One control step, 1/60 s; what is being dragged follows."""
        world, robot, clock = self.world, self.world.robot, np.int32(self.clock)
        if self._answers:
            shown, self._carry = _show(
                world, self._policy, self.seed, self._state, self._carry, clock
            )
            (target,) = self._answers.act(shown, robot.joints)
            self._state, step = _apply(world, self._state, target, clock)
        else:
            self._state, self._carry, step = _step(
                world, self._policy, self.seed, self._state, self._carry, clock
            )
        self.clock += 1
        step = jax.device_get(step)
        link = robot.link_names[robot.moving_spheres.link[step.sphere]]
        self.touching = link if step.clearance < 0.0 else None
        if clock < world.episode.steps:
            self._judge(step, clock)
        # Last, so that what is seen now is what the policy will be shown.
        self._follow(FOLLOW_SPEED * world.episode.period)

    def _judge(self, step: Record, clock: np.int32) -> None:
        valid = np.bool_(self.task.valid(self._state.memory))
        self.verdict = self.verdict.after(step, valid, clock)
        if self.verdict.first_collision_step == clock:
            self.first_collision_link = self.touching

    # -- things moved --

    def move(
        self, what: str, index: int, position: np.ndarray, hold: bool = False, at_once: bool = True
    ) -> None:
        """Puts a "piece" of the furniture, or a "box" of the task's own, at a position [m]; or lets
        it follow with time. A box that drifts is held there while `hold`, and drifts on from there.
        """
        if not self._movable(what)[index]:
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
        """An upright cube more, of 12 cm, away from the arm and its goal: its piece, or None where
        there are enough."""
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
        """(J,) [rad]."""
        return self._state.joint_position

    @property
    def goal_joints(self) -> jax.Array:
        """The goal as joints (J,) [rad]."""
        return jnp.asarray(self._state.problem.goal)

    def _nearest_goal(
        self, position: jax.Array | np.ndarray, quaternion: jax.Array | np.ndarray
    ) -> tuple[jax.Array, jax.Array]:
        problem = self._state.problem
        return _solve(problem.obstacles, problem.goal, position, quaternion, jax.random.key(0))

    # -- what there is to see --

    def look(self) -> Moment:
        """The world as it is now."""
        return jax.device_get(_look(self.world, self._policy, self._state, self._carry))


_step = jit(one_world.step, static_argnums=(0, 2))
_apply = jit(one_world.apply, static_argnums=0)
_look = jit(moment, static_argnums=0)
_solve = jit(nearest_goal)


@partial(jit, static_argnums=(0, 2))
def _begin(
    world: World, policy: Policy, seed: int, problem: Problem
) -> tuple[State, Any, Observation]:
    """The state, what the policy carries, and what it saw, as a batch of one."""
    problem = jax.tree.map(jnp.asarray, problem)
    state, carry, seen = one_world.begin(world, policy, seed, problem)
    return state, carry, _batch_of_one(seen)


@partial(jit, static_argnums=(0, 2))
def _show(
    world: World, policy: Policy, seed: int, state: State, carry: Any, clock: jax.Array
) -> tuple[Observation, Any]:
    """What lies over the host policy makes of what it sees, as a batch of one."""
    shown, carry = one_world.act(world, policy, seed, state, carry, clock)
    return _batch_of_one(shown), carry


def _batch_of_one(observation: Observation) -> Observation:
    return jax.tree.map(lambda leaf: leaf[None], observation)
