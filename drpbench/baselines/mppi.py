"""`mppi`: sampling-based model-predictive control, from the point cloud or on the obstacle models.

Model predictive path integral control (Williams et al., 2017) of a kinematic arm, in the manner of
STORM (Bhardwaj et al., 2021), which it is not. Every few control steps it draws sequences of
velocities about the best it had, follows each a second ahead among obstacles that go on as they
move now, and takes their mean, each weighted by what it cost:

    v(t) = g(t) a(q) + u(t) v_max          a(q) = (goal - q) / max(time to it at `speed`, dt)
    w_i ~ exp(-(J_i - min J) / T)          T = the cost of the best tenth above the least
    J = sum_k sum_o (w_c (1 - c_ko / m_o)_+^2 + w_h [c_ko < m_o / 4]) + w_g (|e_H| + mean_k |e_k|)
        + w_u mean |u|^2 + w_s mean (1 - g)^2

with the residual velocity u [share of the limits] and the pull g in [0, 1] at a few knots, linear
between them; e_k the way left [rad] after k steps; and c_ko the smallest clearance [m] of the arm's
spheres from what stands (o = 1) and from what moved or appeared since the start (o = 2), each with
a margin of its own. Where the goal leaves less room than the first margin, 0.8 of its room is the
margin. So without residuals it goes straight to the goal and rests there, without noise.
"""

from dataclasses import dataclass, field, replace

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int, Key, PRNGKeyArray

from drpbench.contract import EPISODE, Observation, Scalar
from drpbench.geometry import Primitives
from drpbench.policies import squared_distances
from drpbench.robot import PANDA, Robot

from .replanning import planned_where

_UNSEEN = 1.0e3  # [m]
_STILL = 1e-5  # [m] a step that is rounding
_MOVERS = 4  # models that move, at most
_JUMP = 0.05  # [m] a step that is no motion: something appeared


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Plan:
    """The sequence that is followed, and what was seen a control step ago."""

    knots: Float[Array, "*batch K D"]
    """D = J + 1: residual velocities, shares of the limits, and the pull."""
    since: Float[Array, "*batch"]  # [s] since it was made
    clock: Int[Array, "*batch"]  # control steps of the episode
    places: Float[Array, "*batch N 3"]
    """[m] of the scene's points, or of the models."""
    there: Bool[Array, "*batch N"]
    moved: Bool[Array, "*batch N"]
    """Whether it moved or appeared since the start."""
    key: Key[Array, "*batch"]


@jax.tree_util.register_dataclass
@dataclass(frozen=True)
class Mppi:
    """Sampling-based model-predictive control. Gains in SI units, tuned on problems drawn apart
    from the frozen ones."""

    speed: Scalar = 0.5
    """Share of the velocity limits at which it goes to the goal where nothing is in the way."""
    margin: Scalar = 0.04
    """[m] of clearance from what stands below which nearness costs."""
    margin_moving: Scalar = 0.1
    """The same from what moved or appeared."""
    w_c: Scalar = 0.5
    w_h: Scalar = 3.0
    w_g: Scalar = 1.0
    w_u: Scalar = 0.05
    w_s: Scalar = 0.02
    sigma_u: Scalar = 0.4
    """Standard deviation of the residual velocity's samples, share of the limits."""
    sigma_g: Scalar = 0.5
    """Standard deviation of the pull's samples."""
    point_radius: Scalar = 0.01
    """[m] about each scene point that counts as occupied: the cloud is sparse."""
    horizon: int = field(default=10, metadata={"static": True})
    """Steps looked ahead."""
    ahead: float = field(default=0.1, metadata={"static": True})
    """[s] a step looked ahead, dt."""
    knots: int = field(default=4, metadata={"static": True})
    samples: int = field(default=48, metadata={"static": True})
    """Sequences drawn, a time."""
    rounds: int = field(default=2, metadata={"static": True})
    """Times that sequences are drawn, a plan."""
    replan: int = field(default=3, metadata={"static": True})
    """Control steps between two plans."""
    points: int = field(default=128, metadata={"static": True})
    """Scene points that stand, and half as many that moved, looked at: those nearest to the arm."""
    privileged: bool = field(default=False, metadata={"static": True})
    """Whether it is given the obstacle models, instead of points."""
    robot: Robot = field(default=PANDA, metadata={"static": True})
    control_period: float = field(default=EPISODE.period, metadata={"static": True})

    def init(self, observation: Observation) -> Plan:
        places, there = self._seen(observation)
        return Plan(
            knots=jnp.zeros((self.knots, self.robot.joints + 1)).at[:, -1].set(1.0),
            since=jnp.float32(0.0),
            clock=jnp.int32(0),
            places=places,
            there=there,
            moved=jnp.zeros_like(there),
            key=jax.random.key(0),
        )

    def act(
        self, observation: Observation, carry: Plan, key: PRNGKeyArray | None
    ) -> tuple[Float[Array, " J"], Plan]:
        if key is not None:
            carry = replace(carry, key=key)
        places, there = self._seen(observation)
        moves = there & carry.there & (jnp.abs(places - carry.places).max(-1) > _STILL)
        appeared = there & ~carry.there & (carry.clock > 0)
        carry = replace(carry, moved=carry.moved | moves | appeared)
        plan = planned_where(carry.clock % self.replan == 0, self._planned, observation, carry)
        velocity = self._velocity(
            observation.joint_position,
            observation.goal_joints,
            self._at(plan.knots, plan.since),
            self.robot.servo_lag,
        )
        after = replace(
            plan,
            since=plan.since + jnp.float32(self.control_period),
            clock=plan.clock + 1,
            places=places,
            there=there,
        )
        return observation.joint_position + self.robot.servo_lag * velocity, after

    def _planned(self, observation: Observation, old: Plan) -> Plan:
        """A plan for now, from the rest of the old one."""
        times = jnp.arange(self.knots) * self._apart
        mean = jax.vmap(lambda t: self._at(old.knots, t + old.since))(times)
        field = self._field(observation, old)
        margin = self._margin(field, observation.goal_joints)
        keys = jax.random.split(old.key, self.rounds)
        spread = jnp.full(self.robot.joints + 1, self.sigma_u).at[-1].set(self.sigma_g)
        go = jnp.zeros_like(mean).at[:, -1].set(1.0)
        for key in keys:
            noise = jax.random.normal(key, (self.samples, *mean.shape)) * spread
            drawn = self._within(mean + noise)
            drawn = jnp.concatenate([drawn, jnp.stack([mean, go, jnp.zeros_like(mean)])])
            cost = self._cost(drawn, observation, field, margin)
            least = jnp.min(cost)
            tenth = jnp.sort(cost)[max(1, self.samples // 10)]
            weight = jax.nn.softmax(-(cost - least) / jnp.maximum(tenth - least, 1e-3))
            mean = jnp.einsum("s,skd->kd", weight, drawn)
            best = drawn[jnp.argmin(cost)]
        both = jnp.stack([best, mean])
        cost = self._cost(both, observation, field, margin)
        return replace(old, knots=both[jnp.argmin(cost)], since=jnp.zeros_like(old.since))

    @property
    def _apart(self) -> float:
        """[s] between knots."""
        return self.horizon * self.ahead / max(self.knots - 1, 1)

    def _within(self, knots: Float[Array, "*s K D"]) -> Float[Array, "*s K D"]:
        return jnp.concatenate(
            [jnp.clip(knots[..., :-1], -1.0, 1.0), jnp.clip(knots[..., -1:], 0.0, 1.0)], axis=-1
        )

    def _at(self, knots: Float[Array, "K D"], time: Float[Array, ""]) -> Float[Array, " D"]:
        """Residual and pull at a time [s]; the last knot after the end."""
        return self._shares(time) @ knots

    def _shares(self, times: Float[Array, "*t"]) -> Float[Array, "*t K"]:
        """What each knot counts for at some times [s]."""
        place = jnp.clip(times / self._apart, 0.0, self.knots - 1.0)
        return jnp.maximum(1.0 - jnp.abs(place[..., None] - jnp.arange(self.knots)), 0.0)

    def _velocity(
        self,
        q: Float[Array, "*s J"],
        goal: Float[Array, " J"],
        knot: Float[Array, "*s D"],
        period: float,
    ) -> Float[Array, "*s J"]:
        """[rad/s]"""
        most = jnp.asarray(self.robot.velocity_limit, q.dtype)
        away = goal - q
        left = jnp.max(jnp.abs(away) / (self.speed * most), axis=-1, keepdims=True)
        pull = away / jnp.maximum(left, period)
        return jnp.clip(knot[..., -1:] * pull + knot[..., :-1] * most, -most, most)

    def _cost(
        self,
        drawn: Float[Array, "S K D"],
        observation: Observation,
        field: "_Field",
        margin: Float[Array, "2"],
    ) -> Float[Array, " S"]:
        times = (jnp.arange(self.horizon) + 0.5) * self.ahead
        along = jnp.einsum("hk,skd->hsd", self._shares(times), drawn)
        goal = observation.goal_joints
        lower, upper = (
            jnp.asarray(limit, goal.dtype)
            for limit in (self.robot.joint_lower, self.robot.joint_upper)
        )

        def step(q: Array, knot: Array) -> tuple[Array, Array]:
            q = q + self.ahead * self._velocity(q, goal, knot, self.ahead)
            q = jnp.clip(q, lower, upper)
            return q, q

        start = jnp.broadcast_to(observation.joint_position, (len(drawn), self.robot.joints))
        _, way = jax.lax.scan(step, start, along)  # (H, S, J)
        later = self.ahead * (1.0 + jnp.arange(self.horizon, dtype=jnp.float32))
        clearance = jax.vmap(lambda q, t: self._room(field, q, t))(way, later) / margin  # (H, S, 2)
        near = jnp.square(jnp.maximum(1.0 - clearance, 0.0))
        left = jnp.linalg.norm(goal - way, axis=-1)
        effort = jnp.mean(jnp.sum(jnp.square(along[..., :-1]), axis=-1), axis=0)
        pulled = jnp.mean(jnp.square(1.0 - along[..., -1]), axis=0)
        return (
            self.w_c * jnp.sum(near, axis=(0, 2))
            + self.w_h * jnp.sum(clearance < 0.25, axis=(0, 2))
            + self.w_g * (left[-1] + jnp.mean(left, axis=0))
            + self.w_u * effort
            + self.w_s * pulled
        )

    def _room(
        self, field: "_Field", q: Float[Array, "S J"], time: Float[Array, ""]
    ) -> Float[Array, "S 2"]:
        """Smallest clearance [m] from what stands and from what moved, after `time` [s]."""
        model = self.robot.moving_spheres
        centers = jax.vmap(lambda q: model.world(self.robot.link_poses(q)))(q)
        gaps = field.distance(centers.reshape(-1, 3), time)
        rooms = (gap.reshape(centers.shape[:2]) - jnp.asarray(model.radius) for gap in gaps)
        return jnp.stack([room.min(-1) for room in rooms], axis=-1)

    def _margin(self, field: "_Field", goal: Float[Array, " J"]) -> Float[Array, "2"]:
        """[m] from what stands, which may leave the goal little room, and from what moved."""
        room = self._room(field, goal[None], jnp.float32(0.0))[0, 0]
        least = jnp.where(room > 0.0, jnp.maximum(0.8 * room, 0.004), self.margin)
        return jnp.stack([jnp.minimum(self.margin, least), jnp.float32(self.margin_moving)])

    def _seen(self, observation: Observation) -> tuple[Float[Array, "N 3"], Bool[Array, " N"]]:
        """Places of what is around, to see at the next step how it moves."""
        if self.privileged:
            assert observation.obstacles is not None
            return jnp.asarray(observation.obstacles.position), jnp.asarray(
                observation.obstacles.mask
            )
        return observation.scene_points, observation.scene_mask

    def _field(self, observation: Observation, before: Plan) -> "_Field":
        """What is around, and how it moves [m/s]."""
        places, there = self._seen(observation)
        step = jnp.where((there & before.there)[:, None], places - before.places, 0.0)
        far = jnp.linalg.norm(step, axis=-1, keepdims=True) > _JUMP
        velocity = jnp.where(far, 0.0, step) / self.control_period
        if self.privileged:
            models = observation.obstacles
            assert models is not None
            moved = (there & before.moved).astype(jnp.int32)
            _, movers = jax.lax.top_k(moved, min(_MOVERS, len(moved)))
            standing = replace(models, mask=there & ~before.moved)
            moving = jax.tree.map(lambda leaf: jnp.asarray(leaf)[movers], models)
            moving = replace(moving, mask=(there & before.moved)[movers])
            return _Models(standing, moving, velocity[movers])
        model = self.robot.moving_spheres
        coarse = np.arange(0, model.count, 4)
        arm = model.world(self.robot.link_poses(observation.joint_position))[coarse]
        apart = jnp.min(squared_distances(arm, places), axis=0)

        def nearest(which: Array, count: int) -> tuple[Array, Array]:
            _, index = jax.lax.top_k(-jnp.where(which, apart, _UNSEEN), min(count, len(apart)))
            return jnp.where(which[index, None], places[index], _UNSEEN), velocity[index]

        still, _ = nearest(there & ~before.moved, self.points)
        swift, speed = nearest(there & before.moved, self.points // 2)
        return _Points(still, swift, speed, self.point_radius)


@dataclass(frozen=True)
class _Models:
    """Obstacle models, of which some go on as they move."""

    standing: Primitives
    moving: Primitives
    velocity: Float[Array, "M 3"]

    def distance(
        self, points: Float[Array, "P 3"], time: Float[Array, ""]
    ) -> tuple[Float[Array, " P"], Float[Array, " P"]]:
        """[m] from each point to what stands, and to what moves after `time` [s]."""
        moved = replace(self.moving, position=self.moving.position + time * self.velocity)
        return self.standing.distance(points), moved.distance(points)


@dataclass(frozen=True)
class _Points:
    """Scene points, each a small ball, of which some go on as they move."""

    standing: Float[Array, "N 3"]
    moving: Float[Array, "M 3"]
    velocity: Float[Array, "M 3"]
    radius: Scalar

    def distance(
        self, points: Float[Array, "P 3"], time: Float[Array, ""]
    ) -> tuple[Float[Array, " P"], Float[Array, " P"]]:
        """[m] from each point to what stands, and to what moves after `time` [s]."""

        x, y, z = (points[:, i] for i in range(3))

        def visit(least: Array, at: Array) -> tuple[Array, None]:
            dx, dy, dz = x - at[0], y - at[1], z - at[2]
            return jnp.minimum(least, dx * dx + dy * dy + dz * dz), None

        def nearest(scene: Array) -> Array:
            # Point by point: the distances of all pairs would fill the memory, not the cache.
            farthest = jnp.full(len(points), _UNSEEN**2)
            return jnp.sqrt(jax.lax.scan(visit, farthest, scene, unroll=8)[0]) - self.radius

        return nearest(self.standing), nearest(self.moving + time * self.velocity)


_Field = _Models | _Points
