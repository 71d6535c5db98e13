"""The arm: names and limits, kinematics, collision spheres, surface points."""

from .arms.panda import HOME as HOME
from .arms.panda import JOINT_LOWER as JOINT_LOWER
from .arms.panda import JOINT_UPPER as JOINT_UPPER
from .arms.panda import LINKS as LINKS
from .arms.panda import PANDA_XML as PANDA_XML
from .arms.panda import TORQUE_LIMIT as TORQUE_LIMIT
from .arms.panda import VELOCITY_LIMIT as VELOCITY_LIMIT
from .kinematics import LinkPoses as LinkPoses
from .kinematics import grip_jacobian as grip_jacobian
from .kinematics import grip_pose as grip_pose
from .kinematics import link_poses as link_poses
from .kinematics import point_jacobian as point_jacobian
from .meshes import NO_MESHES as NO_MESHES
from .meshes import find_mesh_model as find_mesh_model
from .spheres import BodyPoints as BodyPoints
from .spheres import moving_spheres as moving_spheres
from .spheres import self_clearance as self_clearance
from .spheres import spheres as spheres
from .spheres import surface_points as surface_points
