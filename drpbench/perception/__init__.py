"""What makes the observation's point cloud: sensors."""

from .surface_cloud import Cloud as Cloud
from .surface_cloud import SurfaceCloud as SurfaceCloud
