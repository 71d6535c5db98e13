"""From what happened to one row: reach, collision, clearance, path length, smoothness."""

import math
from collections.abc import Sequence

import jax
import numpy as np

from drpbench.contract import REACH_POSITION_LOOSE, Verdict, reached
from drpbench.geometry import FAR
from drpbench.results import Row
from drpbench.rollout import Trace

LIMIT_TOLERANCE = 1e-3  # [rad]


def sparc(speed: np.ndarray, rate: float) -> float | None:
    """Spectral arc length of a speed profile sampled at `rate` [Hz]: smoothness, 0 at best.

    Minus the arc length of the amplitude spectrum, scaled to 1 at zero frequency and to 1 across
    the band, up to the last frequency below 10 Hz with more than 5 % of the amplitude
    (Balasubramanian et al. 2015, "On the analysis of movement smoothness"). None for no movement.
    """
    if speed.size < 2 or speed.max() < 1e-4:
        return None
    count = 2 ** (math.ceil(math.log2(speed.size)) + 4)
    spectrum = np.abs(np.fft.rfft(speed, count))
    frequency = np.fft.rfftfreq(count, 1.0 / rate)
    amplitude = (spectrum / spectrum.max())[frequency <= 10.0]
    frequency = frequency[frequency <= 10.0]
    strong = np.nonzero(amplitude >= 0.05)[0]
    band = slice(strong[0], strong[-1] + 1)
    amplitude, frequency = amplitude[band], frequency[band]
    if frequency.size < 2:
        return 0.0
    across = np.diff(frequency) / (frequency[-1] - frequency[0])
    return -float(np.sum(np.hypot(across, np.diff(amplitude))))


def rows(ids: Sequence[int], families: Sequence[str], trace: Trace) -> list[Row]:
    """One row per problem, in the order of the trace."""
    verdicts = trace.verdict
    return [
        _row(id, families[b], trace, jax.tree.map(lambda leaf, b=b: leaf[b], verdicts), b)
        for b, id in enumerate(ids)
    ]


def _number(value: float | np.floating) -> float | None:
    """Six significant digits are more than float32 has; result files stay small."""
    return float(f"{value:.6g}") if np.isfinite(value) else None


def _smoothness(speed: np.ndarray, period: float, finite: bool) -> float | None:
    value = sparc(speed, 1.0 / period) if finite else None
    return None if value is None else _number(value)


def _row(id: int, family: str, trace: Trace, verdict: Verdict, b: int) -> Row:
    robot, period = trace.world.robot, trace.world.episode.period
    finite, collided = bool(verdict.finite), bool(verdict.collided)
    errors = trace.position_error[:, b], trace.orientation_error[:, b]
    at_goal = np.asarray(reached(*errors))
    near_goal = np.asarray(reached(*errors, REACH_POSITION_LOOSE))
    reached_at_end = bool(verdict.reached)
    first = int(verdict.first_collision_step) if collided else None
    nearest = np.min(trace.clearance[:, b], initial=FAR, where=np.isfinite(trace.clearance[:, b]))

    joints = np.concatenate([trace.start[None, b], trace.joint_position[:, b]]).astype(float)
    grip = np.concatenate([trace.start_grip[None, b], trace.grip_position[:, b]]).astype(float)
    joint_steps = np.linalg.norm(np.diff(joints, axis=0), axis=1)
    grip_steps = np.linalg.norm(np.diff(grip, axis=0), axis=1)
    beyond = np.maximum(robot.joint_lower - joints, joints - robot.joint_upper)
    time_to_goal = None
    if reached_at_end:
        away = np.nonzero(~at_goal)[0]
        time_to_goal = _number(((away[-1] + 1 if away.size else 0) + 1) * period)
    at_goal_early = success_early = None
    if removal := trace.world.task.removal:
        last = trace.world.episode.steps - trace.world.episode.lasting(removal)
        met = at_goal[:last]
        at_goal_early = _number(met.sum() * period)
        success_early = finite and bool(met[-1]) and not (first is not None and first < last)
    link = robot.moving_spheres.link
    return Row(
        id=int(id),
        task=trace.world.task.name,
        family=family,
        success=bool(verdict.success),
        reached=reached_at_end,
        reached_5cm=finite and bool(near_goal[-1]),
        reached_once=reached_at_end or bool(at_goal.any()),
        collided=collided,
        first_collision_step=first,
        first_collision_link=None
        if first is None
        else robot.link_names[link[trace.sphere[first, b]]],
        self_collided=bool((trace.self_clearance[:, b] < 0.0).any()),
        min_clearance=_number(nearest) if nearest < 0.5 * FAR else None,
        position_error=_number(trace.position_error[-1, b]),
        orientation_error=_number(trace.orientation_error[-1, b]),
        time_to_goal=time_to_goal,
        joint_path_length=_number(joint_steps.sum()),
        ee_path_length=_number(grip_steps.sum()),
        sparc_joint=_smoothness(joint_steps / period, period, finite),
        sparc_ee=_smoothness(grip_steps / period, period, finite),
        joint_limit_violation=bool((beyond > LIMIT_TOLERANCE).any()),
        time_at_goal_before_removal=at_goal_early,
        success_before_removal=success_early,
        status=trace.failures[b] or ("ok" if finite else "nan"),
        valid=bool(verdict.valid),
    )
