"""One control step of the whole world against C MuJoCo stepping the arm's real meshes, side by
side.

    DRPBENCH_MESHES=FOLDER python benchmarks/world_vs_mujoco.py [--batch 256] [--threads 2]

Ours: dynamics, contact, collision and self-collision verdict, and point clouds, in one JAX program.
Theirs: two physics steps of 1/120 s of the arm with its collision meshes among the same obstacles,
with the same servos and contacts on; no clearance and no point cloud. Same problems, same starts,
same references. The two take turns within one run, so that whatever else the machine does meets
both.
"""

import argparse
import platform
import time

import jax
import mujoco
import numpy as np
from mujoco import rollout
from world_loop import WorldLoop, batch_of, most_obstacles

from drpbench.compile import use_cache
from drpbench.contract import EPISODE
from drpbench.evaluation.machine import device_name
from drpbench.problems import TaskProblems, load_set
from drpbench.robot import PANDA

SUBSTEPS = 2
SHAPES = (mujoco.mjtGeom.mjGEOM_BOX, mujoco.mjtGeom.mjGEOM_CYLINDER, mujoco.mjtGeom.mjGEOM_SPHERE)


def mujoco_model(problems: TaskProblems, index: int) -> mujoco.MjModel:
    """The mesh arm with position servos among the obstacles of one problem, contacts on."""
    path = PANDA.meshes.find()
    if path is None:
        raise SystemExit(PANDA.meshes.absent)
    spec = PANDA.meshes.spec(path, finger_pieces=1)  # whole fingers: MuJoCo at its fastest
    spec.option.timestep = EPISODE.period / SUBSTEPS
    spec.option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    spec.option.gravity = np.zeros(3)
    for joint, most in zip(spec.joints, PANDA.torque_limit, strict=True):
        servo = spec.add_actuator()
        servo.target, servo.trntype = joint.name, mujoco.mjtTrn.mjTRN_JOINT
        servo.set_to_position(kp=1000.0, kv=50.0)
        servo.forcelimited, servo.forcerange = True, [-most, most]
    # Links against obstacles, and only those pairs of links that can touch.
    frames = {name: min(frame, 8) for frame, name in enumerate(PANDA.link_names)}
    for i, a in enumerate(PANDA.link_names):
        for b in PANDA.link_names[i + 1 :]:
            pair = (frames[a], frames[b])
            if not any(
                pair[0] in one and pair[1] in two for one, two in PANDA.self_collision_blocks
            ):
                spec.add_exclude(bodyname1=a, bodyname2=b)
    scene = problems.obstacles[index]
    for kind, half, position, quaternion, exists in zip(
        scene.kind, scene.half_size, scene.position, scene.quaternion, scene.mask, strict=True
    ):
        # A body each: MuJoCo's broad phase works on bodies. One that is masked collides with
        # nothing, and is there because a rollout's models must be of one size.
        geom = spec.worldbody.add_body(pos=position, quat=quaternion).add_geom()
        geom.type = SHAPES[kind]
        geom.size = [half[0], half[2], 0.0] if geom.type == SHAPES[1] else half
        geom.contype = geom.conaffinity = int(exists)
    return spec.compile()


class MujocoLoop:
    """The same worlds in C MuJoCo, spread over threads."""

    def __init__(
        self, problems: TaskProblems, ids: list[int], batch: int, steps: int, threads: int
    ):
        self.batch, self.steps = batch, steps
        models = {index: mujoco_model(problems, index) for index in ids}
        turn = [ids[i % len(ids)] for i in range(batch)]
        self._models = [models[index] for index in turn]
        self._data = [mujoco.MjData(self._models[0]) for _ in range(threads)]
        self._pool = rollout.Rollout(nthread=threads)
        size = mujoco.mj_stateSize(self._models[0], mujoco.mjtState.mjSTATE_FULLPHYSICS)
        start = problems.start[turn].astype(float)
        self._initial = np.zeros((batch, size))
        self._initial[:, 1:8] = start  # time, positions, velocities
        self._control = np.repeat(references(start, problems.goal[turn], steps), SUBSTEPS, axis=1)
        self.seconds()

    def seconds(self) -> float:
        """Time [s] of `steps` control steps of all worlds, from the start."""
        began = time.perf_counter()
        self.final, _ = self._pool.rollout(
            self._models, self._data, self._initial, self._control, skip_checks=False
        )
        return time.perf_counter() - began

    def rate(self) -> float:
        """Control steps per second, over all worlds."""
        return self.batch * self.steps / self.seconds()


def references(start: np.ndarray, goal: np.ndarray, steps: int) -> np.ndarray:
    """(batch, steps, 7) [rad]: what the world's servos aim at while the target is the goal."""
    found, reference = [], start
    most = PANDA.velocity_limit * EPISODE.period
    for _ in range(steps):
        reference = reference + np.clip(goal - reference, -most, most)
        found.append(reference)
    return np.stack(found, axis=1)


def spread(values: list[float]) -> str:
    return f"{np.median(values):.0f} ({min(values):.0f} to {max(values):.0f})"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--task", default="SE", help="C MuJoCo gets its static obstacles only")
    parser.add_argument("--batch", type=int, default=256)
    parser.add_argument("--threads", type=int, default=2, help="of C MuJoCo; JAX takes all cores")
    parser.add_argument("--steps", type=int, default=50, help="control steps a repetition")
    parser.add_argument("--repetitions", type=int, default=9)
    parser.add_argument("--scenes", type=int, default=16)
    arguments = parser.parse_args()
    use_cache()

    problems = load_set().task(arguments.task)
    ids = most_obstacles(problems, arguments.scenes)
    obstacles = problems.obstacles.mask[ids].sum(axis=1)
    ours = WorldLoop(arguments.task, batch_of(problems, ids, arguments.batch), arguments.steps)
    theirs = MujocoLoop(problems, ids, arguments.batch, arguments.steps, arguments.threads)
    rates = [(ours.rate(), theirs.rate()) for _ in range(arguments.repetitions)]

    print(
        f"{device_name()}; {platform.machine()}, jax {jax.__version__}, mujoco "
        f"{mujoco.__version__}; "
        f"{arguments.task}, batch {arguments.batch}, {len(ids)} scenes of {obstacles.min()} to "
        f"{obstacles.max()} obstacles "
        f"({', '.join(sorted({problems.family[i] for i in ids}))}), {arguments.steps} control "
        "steps, "
        f"{arguments.repetitions} repetitions, C MuJoCo on {arguments.threads} threads\n"
    )
    print("| | control steps/s: median (min to max) | µs a control step |\n|---|---|---|")
    for name, values in zip(
        ("the whole world", "C MuJoCo, meshes"), zip(*rates, strict=True), strict=True
    ):
        print(f"| {name} | {spread(values)} | {1e6 / np.median(values):.1f} |")
    ratios = [a / b for a, b in rates]
    print(f"| ratio | {np.median(ratios):.2f} ({min(ratios):.2f} to {max(ratios):.2f}) | |")


if __name__ == "__main__":
    main()
