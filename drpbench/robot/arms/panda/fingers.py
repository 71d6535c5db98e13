"""Where the fingers stand in the hand."""

FINGER_OPENING = 0.04  # [m], each finger from the middle
FINGER_HEIGHT = 0.0584  # [m], finger frames above the hand frame
