"""OMPL (Sucan et al., 2012) in a process of its own, which another interpreter may be.

It reads pickled Requests from its standard input and writes, for each, (number, answer) of every
problem as they come: the waypoints, or a Lost that says why there are none. First of all it writes
a Greeting. Every problem is planned in a fork of its own (`forked.py`), so its random numbers
depend on the problem alone; OMPL 1.7 may abort when its process ends, and that is then nobody's
loss.
"""

import importlib.metadata
import os
import pickle
import sys
import warnings
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from drpbench.geometry import Obstacles
from drpbench.planning.checker import Checker, sphere_checker
from drpbench.planning.rrt_connect import COARSE, Planner
from drpbench.robot import Robot

from .forked import Lost, each_alone

SERVE = "from drpbench.baselines.ompl_server import main; main()"
"""What its interpreter runs. Not `-m`, which would give the classes here a second name."""

_STEP = 0.02  # [rad] between the states of a motion, where a planner wants its last free state
_SLACK = 1e-4  # [m] that the ends may lose to rounding
_PARTIAL = ("kpiece", "pdst")  # planners that ask how far a motion is free


@dataclass(frozen=True)
class Greeting:
    """What this OMPL is. `planners` are names in lower case; `fault` says why there are none."""

    version: str = ""
    planners: tuple[str, ...] = ()
    fault: str = ""


@dataclass(frozen=True)
class Problem:
    """One scene, and from where to where [rad]."""

    obstacles: Obstacles
    start: np.ndarray
    goal: np.ndarray


@dataclass(frozen=True)
class Request:
    """Problems to plan with the same settings; those of `Ompl`."""

    robot: Robot
    planner: str
    time_limit: float
    clearance: float
    seed: int
    processes: int
    problems: list[Problem] = field(default_factory=list)

    @property
    def patience(self) -> float:
        """[s] after which a planner that does not come back is killed."""
        return 2.0 * self.time_limit + 10.0


def planners() -> dict[str, type]:
    """OMPL's geometric planners by their names in lower case. Raises ImportError without OMPL."""
    from ompl import base, geometric

    return {
        name.lower(): found
        for name, found in vars(geometric).items()
        if isinstance(found, type) and issubclass(found, base.Planner)
    }


def _planned(checker: Checker, request: Request, problem: Problem) -> Any:
    """Waypoints (k, J) [rad] of one problem, or a Lost."""
    from ompl import base, geometric, util

    levels = getattr(util, "LogLevel", util)
    util.setLogLevel(levels.LOG_NONE)
    util.RNG.setSeed(request.seed + 1)
    robot = request.robot
    checker.set_obstacles(problem.obstacles)
    lower, upper = robot.joint_lower, robot.joint_upper
    ends = [np.clip(np.asarray(q, float), lower, upper) for q in (problem.start, problem.goal)]
    room = [checker.clearance(q) for q in ends]
    for name, clearance in zip(("start", "goal"), room, strict=True):
        if clearance <= 0.0:
            return Lost(f"the {name} touches something")
    # What the tighter end leaves, if that is less.
    clearance = min(request.clearance, min(room) - _SLACK)
    own = Planner(checker, clearance)

    space, bounds = base.RealVectorStateSpace(robot.joints), base.RealVectorBounds(robot.joints)
    for joint in range(robot.joints):
        bounds.setLow(joint, float(lower[joint]))
        bounds.setHigh(joint, float(upper[joint]))
    space.setBounds(bounds)
    setup = geometric.SimpleSetup(space)
    information = setup.getSpaceInformation()

    def joints(state: Any) -> np.ndarray:
        return np.array([state[joint] for joint in range(robot.joints)])

    def free(state: Any) -> bool:
        return checker.clearance(joints(state)) > clearance

    class Motions(base.MotionValidator):
        """A motion is free if the arm can walk along it in steps that its room allows."""

        def checkMotion(self, a: Any, b: Any, *last: Any) -> bool:  # noqa: N802
            if last:
                raise NotImplementedError("the last free state of a motion")
            return free(b) and own.straight(joints(a), joints(b))

    # OMPL 1 wants a function wrapped and states of a class; OMPL 2 does not.
    wrap = getattr(base, "StateValidityCheckerFn", lambda function: function)
    setup.setStateValidityChecker(wrap(free))
    information.setStateValidityCheckingResolution(_STEP / space.getMaximumExtent())
    if not any(name in request.planner for name in _PARTIAL):
        motions = Motions(information)
        information.setMotionValidator(motions)
    states = [
        base.State(space) if hasattr(base, "StateValidityCheckerFn") else space.allocState()
        for _ in ends
    ]
    for state, q in zip(states, ends, strict=True):
        for joint in range(robot.joints):
            state[joint] = float(q[joint])
    setup.setStartAndGoalStates(*states)
    setup.setPlanner(planners()[request.planner](information))
    setup.solve(request.time_limit)
    if not setup.haveExactSolutionPath():
        return Lost(f"found no path in {request.time_limit:g} s")
    setup.simplifySolution()
    path = setup.getSolutionPath()
    found = np.array([joints(path.getState(i)) for i in range(path.getStateCount())])
    found[0], found[-1] = problem.start, problem.goal
    return found


def main() -> None:
    """Serves until its standard input ends."""
    out = os.fdopen(os.dup(1), "wb")
    os.dup2(2, 1)  # whatever a library prints is no answer
    warnings.filterwarnings("ignore", message=".*fork")

    def say(something: Any) -> None:
        pickle.dump(something, out)
        out.flush()

    try:
        say(Greeting(importlib.metadata.version("ompl"), tuple(planners())))
    except ImportError:
        say(Greeting(fault="no OMPL"))
        return
    checkers: dict[Robot, Checker] = {}
    while True:
        try:
            request: Request = pickle.load(sys.stdin.buffer)
        except EOFError:
            return
        margin = request.clearance + COARSE
        checker = checkers.get(request.robot) or sphere_checker(margin, request.robot)
        checkers[request.robot] = checker
        function = partial(_planned, checker, request)
        for answer in each_alone(function, request.problems, request.processes, request.patience):
            say(answer)
