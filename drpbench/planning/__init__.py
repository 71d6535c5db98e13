"""Motion planning: collision checks, inverse kinematics, sampling planners and the trajectory
optimiser."""
