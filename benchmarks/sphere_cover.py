"""How well the collision spheres stand in for the real arm: on the meshes, and in verdicts.

    python benchmarks/sphere_cover.py [--seed 0] [--near 2000]

(a) Each link's sphere count, largest gap and excess, on fresh random points.
(b) Random scenes and configurations, with the true clearance by C MuJoCo between the real meshes
(their convex hulls, which is all MuJoCo sees of a mesh) and the obstacles: how often the spheres
call a collision where the arm is free by less than 10 mm, and how often they miss one.
"""

import argparse
import sys
import time

import jax
import jax.numpy as jnp
import mujoco
import numpy as np

from drpbench.geometry import (
    BOX,
    CYLINDER,
    SPHERE,
    Primitives,
    quaternion_to_matrix,
    signed_distance,
)
from drpbench.ranking import wilson
from drpbench.robot import PANDA
from drpbench.robot.arms.panda.fingers import FINGER_OPENING
from drpbench.robot.link_meshes import load_link_meshes
from drpbench.robot.sphere_cover import link_spheres, measure_cover, pooled_mean_excess

MM = 1e3
KINDS = np.array([BOX, BOX, CYLINDER, CYLINDER, SPHERE, SPHERE])
GEOM_TYPES = {
    BOX: mujoco.mjtGeom.mjGEOM_BOX,
    CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE,
}
CONFIGURATIONS = 200  # per scene
NEAR = 0.010  # [m]


def print_figures(model_path, seed: int) -> None:
    meshes = load_link_meshes(model_path)
    figures = {}
    print(f"{'link':14}{'spheres':>8}{'gap':>8}{'mean':>8}{'max':>8}   [mm]: largest gap, excess")
    for name in PANDA.link_names:
        rows = link_spheres(PANDA, name)
        f = figures[name] = measure_cover(meshes[name], rows, 50_000, seed)
        print(
            f"{name:14}{len(rows):8}{MM * f.largest_gap:8.2f}{MM * f.mean_excess:8.2f}"
            f"{MM * f.max_excess:8.2f}",
            flush=True,
        )
    for title, group in (
        ("link1..link7", PANDA.link_names[1:8]),
        ("hand, fingers", PANDA.link_names[8:]),
    ):
        chosen = [figures[name] for name in group]
        print(
            f"{title:14}{sum(len(link_spheres(PANDA, name)) for name in group):8}"
            f"{MM * max(f.largest_gap for f in chosen):8.2f}{MM * pooled_mean_excess(chosen):8.2f}"
            f"{MM * max(f.max_excess for f in chosen):8.2f}"
        )
    print(f"{'all but link0':14}{PANDA.moving_spheres.count:8}\n")


def draw_scene(rng: np.random.Generator) -> Primitives:
    """Two boxes, two cylinders and two spheres about the arm's workspace."""
    n = len(KINDS)
    half = rng.uniform((0.02, 0.02, 0.02), (0.2, 0.2, 0.3), size=(n, 3))
    half[KINDS != BOX, 1] = half[KINDS != BOX, 0]
    half[KINDS == SPHERE, 2] = half[KINDS == SPHERE, 0]
    position = rng.uniform((-0.8, -0.8, 0.0), (0.8, 0.8, 1.1), size=(n, 3))
    quaternion = rng.standard_normal((n, 4))
    quaternion /= np.linalg.norm(quaternion, axis=1, keepdims=True)
    rotation = np.asarray(quaternion_to_matrix(quaternion))
    return Primitives(KINDS, half, position, rotation, np.ones(n, bool))


class Truth:
    """Clearance between the real meshes of link1 to the fingers and six obstacles."""

    def __init__(self, model_path):
        spec = mujoco.MjSpec.from_file(str(model_path))
        for i, kind in enumerate(KINDS):
            spec.worldbody.add_geom(
                name=f"obstacle{i}", type=GEOM_TYPES[int(kind)], size=[0.1, 0.1, 0.1]
            )
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)
        self.obstacles = np.array([self.model.geom(f"obstacle{i}").id for i in range(len(KINDS))])
        bodies = [self.model.body(name).id for name in PANDA.link_names[1:]]
        solid = (self.model.geom_contype != 0) | (self.model.geom_conaffinity != 0)
        self.arm = np.flatnonzero(np.isin(self.model.geom_bodyid, bodies) & solid)

    def place(self, scene: Primitives) -> None:
        model, self.scene = self.model, scene
        size = scene.half_size.copy()
        size[KINDS == CYLINDER, 1] = size[KINDS == CYLINDER, 2]  # MuJoCo: radius, half height
        model.geom_size[self.obstacles] = size
        model.geom_rbound[self.obstacles] = np.linalg.norm(scene.half_size, axis=1)

    def clearance(self, q: np.ndarray) -> float:
        """Smallest distance [m], negative by the penetration depth; NEAR or more where free."""
        data, model = self.data, self.model
        data.qpos[:7], data.qpos[7:] = q, FINGER_OPENING
        mujoco.mj_kinematics(model, data)
        # Set here and not in the model: geoms compiled at the origin are taken to stay there.
        data.geom_xpos[self.obstacles] = self.scene.position
        data.geom_xmat[self.obstacles] = self.scene.rotation.reshape(-1, 9)
        # Bounding spheres first: what they keep apart by more than NEAR cannot matter.
        apart = np.linalg.norm(
            data.geom_xpos[self.arm, None] - data.geom_xpos[None, self.obstacles], axis=-1
        )
        apart -= model.geom_rbound[self.arm, None] + model.geom_rbound[None, self.obstacles]
        least = NEAR
        for i, j in np.argwhere(apart < NEAR):
            pair = int(self.arm[i]), int(self.obstacles[j])
            least = min(least, mujoco.mj_geomDistance(model, data, *pair, NEAR, None))
        return least


def verdict_figures(model_path, seed: int, wanted: int) -> tuple[np.ndarray, np.ndarray, int]:
    """True clearance and sphere clearance [m] of configurations, until `wanted` are near."""
    rng = np.random.default_rng(seed)
    truth = Truth(model_path)

    @jax.jit
    @jax.vmap
    def _positions(q):
        return PANDA.moving_spheres.world(PANDA.link_poses(q))

    @jax.jit
    def sphere_clearance(q, scene):
        distance = signed_distance(_positions(q), scene) - PANDA.moving_spheres.radius
        return jnp.min(distance, axis=-1)

    true, by_spheres, near, scenes = [], [], 0, 0
    while near < wanted:
        scene = draw_scene(rng)
        truth.place(scene)
        q = rng.uniform(PANDA.joint_lower, PANDA.joint_upper, size=(CONFIGURATIONS, 7))
        true.append(np.array([truth.clearance(row) for row in q]))
        scene32 = jax.tree.map(
            lambda leaf: leaf.astype(np.float32) if leaf.dtype == np.float64 else leaf, scene
        )
        by_spheres.append(np.asarray(sphere_clearance(q.astype(np.float32), scene32)))
        near += int(((true[-1] > 0.0) & (true[-1] < NEAR)).sum())
        scenes += 1
    return np.concatenate(true), np.concatenate(by_spheres), scenes


def share(k: int, n: int) -> str:
    low, high = wilson(k, n)
    rate = 100.0 * k / n if n else float("nan")
    return f"{k}/{n} = {rate:.2f} % (95 % Wilson {100 * low:.2f} to {100 * high:.2f} %)"


def print_verdicts(model_path, seed: int, wanted: int) -> None:
    start = time.perf_counter()
    true, by_spheres, scenes = verdict_figures(model_path, seed, wanted)
    collided = by_spheres < 0.0
    free = true > 0.0
    print(
        f"{len(true)} configurations in {scenes} scenes, {free.sum()} free, "
        f"{time.perf_counter() - start:.0f} s"
    )
    print("truly free, called a collision by the spheres:")
    for low, high in [(0.0, NEAR), *((m / MM, (m + 2) / MM) for m in range(0, 10, 2))]:
        band = (true > low) & (true < high if high == NEAR else true <= high)
        label = f"clearance {MM * low:.0f} to {MM * high:.0f} mm"
        print(f"  {label:24} {share(int((collided & band).sum()), int(band.sum()))}")
    print(f"  {'any clearance':24} {share(int((collided & free).sum()), int(free.sum()))}")
    print("truly colliding, missed by the spheres:")
    for depth in (0.0, 0.003, 0.005):
        deep = true < -depth
        label = f"deeper than {MM * depth:.0f} mm"
        print(f"  {label:24} {share(int((~collided & deep).sum()), int(deep.sum()))}")


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--near", type=int, default=2000, help="configurations within 10 mm, free")
    args = parser.parse_args()
    model_path = PANDA.meshes.find()
    if model_path is None:
        print(PANDA.meshes.absent, file=sys.stderr)
        return 2
    print_figures(model_path, args.seed)
    print_verdicts(model_path, args.seed, args.near)
    return 0


if __name__ == "__main__":
    sys.exit(main())
