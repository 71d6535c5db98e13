"""Where a video is seen from: places by name, three numbers, or close to the first contact."""

from dataclasses import dataclass

import mujoco
import numpy as np

from .episode import RecordingError
from .motion import Motion

CONTACT = "contact"


@dataclass(frozen=True)
class Camera:
    """Looks at a place from so far away, `azimuth` about the vertical and `elevation` above the
    horizon, as MuJoCo counts them."""

    azimuth: float  # [deg], 0 looks along +x
    elevation: float  # [deg], negative looks down
    distance: float  # [m]
    at: tuple[float, float, float] = (0.28, 0.0, 0.37)  # [m]

    def aim(self, camera: mujoco.MjvCamera) -> None:
        """Sets MuJoCo's camera so."""
        camera.lookat[:], camera.distance = self.at, self.distance
        camera.azimuth, camera.elevation = self.azimuth, self.elevation


CAMERAS = {
    "corner": Camera(52.0, -24.0, 1.8),
    "front": Camera(180.0, -15.0, 1.9),
    "back": Camera(0.0, -20.0, 2.0),
    "left": Camera(-90.0, -12.0, 1.9),
    "right": Camera(90.0, -12.0, 1.9),
    "top": Camera(0.0, -89.0, 1.9),
}


def camera(name: str, motion: Motion | None = None) -> Camera:
    """The camera of this name, or at `AZIMUTH,ELEVATION,DISTANCE`.

    "contact" is close to where the arm first touches in `motion`, or to where it comes nearest.
    Raises RecordingError for anything else.
    """
    if name == CONTACT and motion is not None:
        return _close(motion)
    if name in CAMERAS:
        return CAMERAS[name]
    try:
        azimuth, elevation, distance = map(float, name.split(","))
        if not (np.isfinite(azimuth) and -90 <= elevation <= 90 and 0.1 <= distance <= 20):
            raise ValueError(name)
    except ValueError:
        known = ", ".join([*CAMERAS, CONTACT])
        raise RecordingError(
            f"no camera {name!r}; there are: {known}, or AZIMUTH,ELEVATION,DISTANCE such as "
            "52,-24,1.8 ([deg], -90 to 90, 0.1 to 20 m)"
        ) from None
    return Camera(azimuth, elevation, distance)


def _close(motion: Motion) -> Camera:
    touching = np.flatnonzero(motion.touching)
    instant = int(touching[0]) if touching.size else int(motion.clearance.argmin())
    at = motion.contact_point[instant]
    # Seen from its side, neither the arm nor the obstacle hides the contact.
    bearing = np.degrees(np.arctan2(at[1], at[0]))
    return Camera(bearing + 125.0, -20.0, 0.7, (float(at[0]), float(at[1]), float(at[2])))
