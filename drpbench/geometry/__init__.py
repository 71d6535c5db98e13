"""Solids and scenes of them, distance fields, surfaces, rotations."""

from .distance import FAR as FAR
from .distance import nearest as nearest
from .distance import normal as normal
from .distance import signed_distance as signed_distance
from .field import Field as Field
from .obstacles import Obstacles as Obstacles
from .obstacles import stacked as stacked
from .primitives import BOX as BOX
from .primitives import CYLINDER as CYLINDER
from .primitives import MAX_OBSTACLES as MAX_OBSTACLES
from .primitives import SHAPES as SHAPES
from .primitives import SPHERE as SPHERE
from .primitives import Primitives as Primitives
from .primitives import concatenate as concatenate
from .rotation import matrix_to_quaternion as matrix_to_quaternion
from .rotation import quaternion_to_matrix as quaternion_to_matrix
from .rotation import rotation_angle as rotation_angle
from .sampling import areas as areas
from .sampling import sample_surface as sample_surface
from .voxel_field import VoxelField as VoxelField
