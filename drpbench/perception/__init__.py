"""What makes the observation's point cloud."""
