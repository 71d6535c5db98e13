"""The arm as a value: limits, kinematics, collision spheres, surface points. Each arm has a folder
in `arms/`."""

from .arms import ARMS as ARMS
from .arms import PANDA as PANDA
from .arms import arm as arm
from .body_points import BodyPoints as BodyPoints
from .body_points import Link as Link
from .link_poses import LinkPoses as LinkPoses
from .link_poses import directional_jacobian as directional_jacobian
from .link_poses import point_jacobian as point_jacobian
from .robot import RealMeshes as RealMeshes
from .robot import Robot as Robot
from .solids import GREY as GREY
from .solids import WHITE as WHITE
from .solids import Solid as Solid
