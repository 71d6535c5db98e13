"""What makes the observation's scene points."""

from typing import Any, Protocol, runtime_checkable

from jaxtyping import Array, Bool, Float, PRNGKeyArray

from drpbench.robot import LinkPoses, Robot

from .movers import Movers
from .problem import Problem


@runtime_checkable
class Sensor(Protocol):
    """A sensor, as pure functions for one world. A hashable value: it is static under jit.

    Its state is whatever pytree it needs; it is made once an episode and never changes, so that an
    observation can be made again from a recorded episode. A sensor that looks from somewhere (a
    depth camera) finds the arm that stands in its view at `poses`: its spheres are
    `robot.spheres.world(poses)`.
    """

    @property
    def points(self) -> int:
        """N, how many points an observation has, those that are masked included."""
        ...

    def reset(self, keys: tuple[PRNGKeyArray, PRNGKeyArray], problem: Problem, movers: int) -> Any:
        """What the sensor carries through an episode with up to `movers` moving boxes.

        `keys` are two independent random keys: all of the sensor's randomness.
        """
        ...

    def observe(
        self, state: Any, problem: Problem, movers: Movers, robot: Robot, poses: LinkPoses
    ) -> tuple[Float[Array, "N 3"], Bool[Array, " N"]]:
        """Points [m] in the world frame, and where there is one; the others are zero."""
        ...
