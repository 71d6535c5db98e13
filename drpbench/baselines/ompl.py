"""`ompl`: a sampling-based planner of OMPL (Sucan et al., 2012) as a policy that knows the models.

When an episode begins it plans to the goal among the obstacles as they stand, simplifies the path,
gives it its times within the arm's limits (`retiming.retime`), and tracks it. The paper runs AIT*
(Strub and Gammell, 2020) so, for 80 s a problem. With `replan` it plans again from where the arm is
every so many control steps; the world waits for it, so that costs it nothing.
"""

import os
import pickle
import shutil
import subprocess
import sys
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from drpbench.contract import EPISODE, UNSTATED, HostObservation
from drpbench.errors import DrpbenchError, suggested
from drpbench.geometry import Obstacles
from drpbench.geometry.host_rotation import from_matrix
from drpbench.robot import PANDA, Robot

from .forked import Lost
from .ompl_server import SERVE, Greeting, Problem, Request
from .tracking import Tracks

_FIRST_CHOICE = ("aitstar", "rrtconnect")


@dataclass
class Ompl:
    """Plans with OMPL, and tracks. Privileged. A host policy.

    Raises DrpbenchError, one line: an argument is not as expected, or there is no such OMPL.
    """

    planner: str = ""
    """Its name in lower case, such as "bitstar"; "" is "aitstar" where OMPL has it (1.7), else
    "rrtconnect"."""
    time_limit: float = 5.0
    """[s] of planning a problem. Planners that improve their path take all of it."""
    replan: int = 0
    """Control steps between two plans; 0: there is one plan."""
    clearance: float = 0.01
    """[m] kept from obstacles, or as much as start and goal have."""
    speed: float = 0.5
    """Share of the pace that the arm's limits allow."""
    seed: int = 0
    version: str = field(default="", init=False)
    """OMPL's"""
    processes: int = field(default=0, metadata=UNSTATED)
    """Problems planned at once; 0: one a core."""
    interpreter: str = field(default="", metadata=UNSTATED)
    """The Python that has OMPL and drpbench; "" is this one."""
    robot: Robot = PANDA
    control_period: float = EPISODE.period

    arrays = "numpy"
    privileged = True

    def __post_init__(self) -> None:
        for name in ("time_limit", "speed"):
            if not 0.0 < (value := getattr(self, name)) < np.inf:
                raise DrpbenchError(f"ompl: {name}={value:g}: expected more than 0")
        if self.replan < 0 or self.processes < 0 or self.clearance < 0:
            raise DrpbenchError("ompl: replan, processes and clearance: expected 0 or more")
        self.cores = self.processes or os.cpu_count() or 1
        self._interpreter = self.interpreter or sys.executable
        self._server: subprocess.Popen | None = None
        self.failures: tuple[str, ...] = ()
        greeting = self._begin()
        self.version = greeting.version
        known = greeting.planners
        self.planner = self.planner or next(name for name in _FIRST_CHOICE if name in known)
        if self.planner not in known:
            self.close()
            newer = "; AIT* is in OMPL 1.7 only: interpreter=PYTHON names one that has it"
            raise DrpbenchError(
                f"ompl: OMPL {self.version} has no planner {self.planner!r}; it has: "
                f"{', '.join(sorted(known))}{newer if self.planner == 'aitstar' else ''}"
                f"{suggested(self.planner, list(known))}"
            )

    def reset(self, observation: HostObservation) -> None:
        self._steps = 0
        self._tracks = Tracks(
            observation.joint_position, self.speed, self.robot, self.control_period
        )
        found = self._plan(observation)
        # With `replan` there is another chance; then it only has not reached the goal.
        self.failures = tuple(
            f"planner: {path}" if isinstance(path, Lost) and not self.replan else ""
            for path in found
        )

    def act(self, observation: HostObservation) -> np.ndarray:
        if self.replan and self._steps and self._steps % self.replan == 0:
            self._plan(observation)
        self._steps += 1
        return self._tracks.targets()

    def close(self) -> None:
        """Ends the planner's process."""
        if self._server is not None:
            self._server.kill()
            self._server.wait()
            self._server = None

    def __del__(self) -> None:
        if getattr(self, "_server", None) is not None:
            self.close()

    def _plan(self, observation: HostObservation) -> list[Any]:
        """The paths that are found from where the arms are are tracked from now on."""
        found = self.paths(observation)
        for i, path in enumerate(found):
            if not isinstance(path, Lost):
                self._tracks.follow(i, path)
        return found

    def paths(self, observation: HostObservation) -> list[Any]:
        """Waypoints (k, J) of every instance from where the arm is to the goal, or why there are
        none."""
        if self._server is None or self._server.poll() is not None:
            self._begin()
        assert self._server is not None and self._server.stdin and self._server.stdout
        scenes = observation.obstacles
        problems = [
            Problem(
                _obstacles(scenes, i), observation.joint_position[i], observation.goal_joints[i]
            )
            for i in range(len(observation.joint_position))
        ]
        request = Request(
            self.robot,
            self.planner,
            self.time_limit,
            self.clearance,
            self.seed,
            self.cores,
            problems,
        )
        found: list[Any] = [Lost("its process ended") for _ in problems]
        try:
            pickle.dump(request, self._server.stdin)
            self._server.stdin.flush()
            for _ in problems:
                number, path = pickle.load(self._server.stdout)
                found[number] = path
        except (EOFError, BrokenPipeError):
            self.close()
        return found

    def _begin(self) -> Greeting:
        """Starts the planner's process. Raises DrpbenchError."""
        if not hasattr(os, "fork"):
            raise DrpbenchError("ompl: needs a system that forks processes: Linux or macOS")
        if shutil.which(self._interpreter) is None:
            raise DrpbenchError(f"ompl: interpreter={self._interpreter}: there is no such program")
        command = [self._interpreter, "-c", SERVE]
        self._server = subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE)
        assert self._server.stdout
        try:
            greeting = pickle.load(self._server.stdout)
        except (EOFError, pickle.UnpicklingError):
            greeting = Greeting(fault="no drpbench of this version")
        if greeting.fault:
            self.close()
            raise DrpbenchError(
                f"ompl: {self._interpreter} has {greeting.fault}: "
                f'{self._interpreter} -m pip install "drpbench[ompl]"'
            )
        return greeting


def _obstacles(scenes: Any, i: int) -> Obstacles:
    """One instance's obstacles, for C MuJoCo."""
    return Obstacles(
        kind=np.asarray(scenes.kind[i]),
        half_size=np.asarray(scenes.half_size[i]),
        position=np.asarray(scenes.position[i]),
        quaternion=np.stack([from_matrix(one) for one in np.asarray(scenes.rotation[i], float)]),
        mask=np.asarray(scenes.mask[i]),
    )
