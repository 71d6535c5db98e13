"""Making a policy: the expert, its data, and training."""
