"""`curobo`: NVIDIA's cuRobo (Sundaralingam et al., 2023; version 0.8) as a policy that knows the
models.

An adapter: cuRobo is no dependency, and needs its own machine. When an episode begins, and every
few control steps, it plans in joint space to the goal, among the obstacles as they stand; the path
gets its times within the arm's limits (`retiming.retime`) and is tracked. The paper replans every
15 control steps on moving obstacles and not at all in SE and GB, with 20 attempts; so `replan=0`
is its setting there.

Cuboids are cuRobo's own; cylinders and spheres are meshes there (`get_collision_check_world`).
"""

import math
from dataclasses import dataclass, field
from importlib import import_module
from importlib.metadata import PackageNotFoundError, version
from typing import Any

import numpy as np

from drpbench.contract import EPISODE, HostObservation
from drpbench.errors import DrpbenchError
from drpbench.geometry import BOX, CYLINDER, MAX_OBSTACLES
from drpbench.geometry.host_rotation import from_matrix
from drpbench.robot import PANDA, Robot

from .tracking import Tracks

SOURCE = "NVIDIA's cuRobo 0.8, built from its sources (github.com/NVlabs/curobo) on a CUDA machine"


@dataclass
class Curobo:
    """Plans with cuRobo, and tracks. Privileged. A host policy.

    Raises DrpbenchError, one line: an argument is not as expected, or there is no cuRobo, or no GPU
    for it.
    """

    replan: int = 15
    """Control steps between two plans; 0: there is one plan."""
    attempts: int = 20
    """Of the planner at a problem, before it gives up."""
    speed: float = 0.5
    """Share of the pace that the arm's limits allow."""
    version: str = field(default="", init=False)
    """cuRobo's"""
    robot: Robot = PANDA
    control_period: float = EPISODE.period

    arrays = "numpy"
    privileged = True

    def __post_init__(self) -> None:
        if not 0.0 < self.speed < math.inf:
            raise DrpbenchError(f"curobo: speed={self.speed:g}: expected more than 0")
        if self.replan < 0 or self.attempts < 1:
            raise DrpbenchError("curobo: expected replan of 0 or more and attempts of 1 or more")
        if self.robot.name != PANDA.name:
            raise DrpbenchError(f"curobo: plans for {PANDA.name} alone, not for {self.robot.name}")
        planning = _module("curobo.motion_planner")
        self._scenes, self._types = _module("curobo.scene"), _module("curobo.types")
        self._torch = _module("torch")
        if not self._torch.cuda.is_available():
            raise DrpbenchError("curobo: there is no CUDA device, and cuRobo runs on nothing else")
        try:
            self.version = version("nvidia-curobo")
        except PackageNotFoundError:
            self.version = "of an unknown version"
        # Either kind may be all of a scene's.
        room = {"cuboid": MAX_OBSTACLES, "mesh": MAX_OBSTACLES}
        settings = planning.MotionPlannerCfg.create(robot="franka.yml", collision_cache=room)
        self._planner = planning.MotionPlanner(settings)
        self._planner.warmup()
        self.failures: tuple[str, ...] = ()

    def reset(self, observation: HostObservation) -> None:
        joints = observation.joint_position
        self._steps = 0
        self._tracks = Tracks(joints, self.speed, self.robot, self.control_period)
        found = self._plan(observation)
        # With `replan` there is another chance; then it only has not reached the goal.
        self.failures = tuple(
            "" if there or self.replan else "planner: cuRobo found no path" for there in found
        )

    def act(self, observation: HostObservation) -> np.ndarray:
        if self.replan and self._steps and self._steps % self.replan == 0:
            self._plan(observation)
        self._steps += 1
        return self._tracks.targets()

    def _plan(self, observation: HostObservation) -> list[bool]:
        """Which instances have a new path, from where their arm is; it is tracked from now on."""
        found = []
        for instance, (q, goal) in enumerate(
            zip(observation.joint_position, observation.goal_joints, strict=True)
        ):
            self._planner.update_world(scene(self._scenes, observation.obstacles, instance))
            planned = self._planner.plan_cspace(
                self._state(goal), self._state(q), max_attempts=self.attempts
            )
            found.append(planned is not None and bool(planned.success.any()))
            if found[-1]:
                way = planned.get_interpolated_plan().position
                path = way.reshape(-1, way.shape[-1])[:, : self.robot.joints].cpu().numpy()
                self._tracks.follow(instance, np.concatenate([q[None], path, goal[None]]))
        return found

    def _state(self, q: np.ndarray) -> Any:
        joints = self._torch.tensor(q[None], device="cuda", dtype=self._torch.float32)
        return self._types.JointState.from_position(joints, joint_names=self._planner.joint_names)


def scene(scenes: Any, obstacles: Any, instance: int) -> Any:
    """The obstacles of one instance as cuRobo's scene, of solids that its checker has.

    `scenes` is the module `curobo.scene`; poses there are [x, y, z, qw, qx, qy, qz] in metres.
    """
    solids: dict[str, list] = {"cuboid": [], "cylinder": [], "sphere": []}
    for slot in np.flatnonzero(np.asarray(obstacles.mask[instance])):
        kind = int(obstacles.kind[instance][slot])
        half = np.asarray(obstacles.half_size[instance][slot], float)
        turn = from_matrix(np.asarray(obstacles.rotation[instance][slot], float))
        place = np.asarray(obstacles.position[instance][slot], float)
        told = {"name": f"obstacle_{slot}", "pose": [*place.tolist(), *turn.tolist()]}
        if kind == BOX:
            solids["cuboid"].append(scenes.Cuboid(dims=(2 * half).tolist(), **told))
        elif kind == CYLINDER:
            size = {"radius": float(half[0]), "height": float(2 * half[2])}
            solids["cylinder"].append(scenes.Cylinder(**size, **told))
        else:
            solids["sphere"].append(scenes.Sphere(radius=float(half[0]), **told))
    return scenes.Scene(**solids).get_collision_check_world()


def _module(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError as error:
        raise DrpbenchError(f"curobo: needs {SOURCE}; importing {name} failed: {error}") from None
