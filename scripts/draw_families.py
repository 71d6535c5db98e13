"""Draws `docs/families.png`: one tile a scene family, from the frozen problems.

    MUJOCO_GL=osmesa python scripts/draw_families.py

The arm stands at the start (white); where its hand has to go is drawn as a ghost (orange).
"""

from __future__ import annotations

import argparse
import json
import os
from pathlib import Path

os.environ.setdefault("MUJOCO_GL", "osmesa")

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import mujoco
import numpy as np

from drpbench.geometry import BOX, CYLINDER, SPHERE
from drpbench.problems import load_set
from drpbench.robot import PANDA

GEOM_TYPE = {
    BOX: mujoco.mjtGeom.mjGEOM_BOX,
    CYLINDER: mujoco.mjtGeom.mjGEOM_CYLINDER,
    SPHERE: mujoco.mjtGeom.mjGEOM_SPHERE,
}
START_COLOUR, GOAL_COLOUR = (0.93, 0.93, 0.95, 1.0), (1.0, 0.45, 0.05, 1.0)
GHOST = 0.45  # opacity of the goal
TABLE_COLOUR, BAR_COLOUR = (0.55, 0.50, 0.44, 1.0), (0.40, 0.42, 0.46, 1.0)
WOOD, STEEL, CARDBOARD = (0.74, 0.58, 0.38, 1.0), (0.80, 0.83, 0.86, 1.0), (0.78, 0.64, 0.45, 1.0)
BODY = {
    "dishwasher": STEEL,
    "microwave": STEEL,
    "box": CARDBOARD,
    "wall_cabinet": (0.86, 0.84, 0.78, 1.0),
}
# One problem a family, each from a tight pose to a tight one, the bare table's apart.
SHOWN = (
    *(("SE", index) for index in (56, 89, 58, 59, 92, 93, 126, 63)),
    ("FDO", 0),
)
PALETTE = plt.get_cmap("tab10").colors


def arm(colour) -> mujoco.MjSpec:
    """The arm's collision spheres in one colour."""
    spec = mujoco.MjSpec.from_file(str(PANDA.model))
    by_link = json.loads((PANDA.folder / "spheres.json").read_text())
    for link in PANDA.link_names:
        for x, y, z, radius in by_link[link]:
            geom = spec.body(link).add_geom()
            geom.type, geom.size, geom.pos = GEOM_TYPE[SPHERE], [radius, 0, 0], [x, y, z]
            geom.rgba = colour
    return spec


def furniture_colours(family: str, kind, half_size) -> list[tuple]:
    """Boards in the furniture's colour, loose solids in many, bars in grey: by shape and size."""
    colours = [TABLE_COLOUR]
    for index in range(1, len(kind)):
        half = half_size[index]
        if kind[index] == BOX and (half.max() > 0.09):
            colours.append(BODY.get(family, WOOD))
        elif kind[index] == CYLINDER and half[0] < 0.02:
            colours.append(BAR_COLOUR)
        else:
            colours.append((*PALETTE[index % 10], 1.0))
    return colours


def picture(problem, pixels: int) -> np.ndarray:
    """Rendered tile (pixels, pixels, 3) uint8 of a problem: obstacle arrays, `start` and `goal`."""
    spec = arm(START_COLOUR)
    frame = spec.worldbody.add_frame()
    goal_arm = arm(GOAL_COLOUR)
    for geom in list(goal_arm.body("link0").geoms):
        goal_arm.delete(geom)  # it does not move: one base is enough
    spec.attach(goal_arm, prefix="goal_", frame=frame)
    colours = furniture_colours(problem["family"], problem["kind"], problem["half_size"])
    for index, colour in enumerate(colours):
        half = problem["half_size"][index]
        geom = spec.worldbody.add_geom()
        geom.type = GEOM_TYPE[int(problem["kind"][index])]
        geom.size = [half[0], half[2], 0] if problem["kind"][index] == CYLINDER else half
        geom.pos, geom.quat = problem["position"][index], problem["quaternion"][index]
        geom.rgba = colour
    for x, y in ((-1.0, -1.5), (-1.0, 1.5)):
        light = spec.worldbody.add_light()
        light.pos, light.dir = [x, y, 2.5], [-x, -y, -2.0]
        light.diffuse = [0.45, 0.45, 0.45]
    spec.visual.headlight.ambient = [0.35, 0.35, 0.35]
    spec.visual.headlight.diffuse = [0.35, 0.35, 0.35]
    spec.visual.global_.offwidth = spec.visual.global_.offheight = pixels
    texture = spec.add_texture()
    texture.name, texture.type = "sky", mujoco.mjtTexture.mjTEXTURE_SKYBOX
    texture.builtin = mujoco.mjtBuiltin.mjBUILTIN_FLAT
    texture.rgb1, texture.width, texture.height = [1, 1, 1], 64, 64
    model = spec.compile()
    data = mujoco.MjData(model)
    data.qpos[:7], data.qpos[7:14] = problem["start"], problem["goal"]
    mujoco.mj_forward(model, data)
    camera = mujoco.MjvCamera()
    furniture = problem["position"][1:].mean(axis=0) if len(problem["kind"]) > 1 else (0.4, 0, 0.2)
    side = -1 if furniture[1] > 0 else 1
    # Lookat between arm and furniture; the camera stands on the arm's side, so that it sees fronts.
    camera.lookat[:] = 0.6 * np.asarray(furniture) + (0, 0, 0.14)
    bearing = np.degrees(np.arctan2(furniture[1], furniture[0]))
    camera.azimuth, camera.elevation, camera.distance = bearing - side * 46, -22, 1.75
    ghost = [
        i for i in range(model.ngeom) if model.body(model.geom_bodyid[i]).name.startswith("goal")
    ]
    with mujoco.Renderer(model, pixels, pixels) as renderer:
        renderer.update_scene(data, camera)
        with_goal = renderer.render().astype(float)
        model.geom_rgba[ghost, 3] = 0.0
        renderer.update_scene(data, camera)
        without = renderer.render().astype(float)
    # Blended as whole pictures: blended sphere by sphere, an arm of spheres would look solid.
    return (GHOST * with_goal + (1 - GHOST) * without).astype(np.uint8)


def stored(task: str, index: int) -> dict:
    """Obstacles, start and goal of a frozen problem, and what the tile is called."""
    problems = load_set().task(task)
    there = problems.obstacles[index].present()
    return {
        **{name: getattr(there, name) for name in ("kind", "half_size", "position", "quaternion")},
        "start": problems.start[index],
        "goal": problems.goal[index],
        "family": problems.family[index],
        "title": f"{problems.family[index].replace('_', ' ')}  ({task} {index})",
    }


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("docs/families.png"))
    parser.add_argument("--pixels", type=int, default=640)
    arguments = parser.parse_args()
    figure, axes = plt.subplots(3, 3, figsize=(12, 12.6))
    for axis, shown in zip(axes.flat, SHOWN, strict=True):
        problem = stored(*shown)
        axis.imshow(picture(problem, arguments.pixels))
        axis.set_title(problem["title"], fontsize=13)
        axis.axis("off")
    figure.tight_layout(pad=0.4)
    arguments.out.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(arguments.out, dpi=100)


if __name__ == "__main__":
    main()
