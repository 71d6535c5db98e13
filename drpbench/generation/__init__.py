"""Drawing problems: scene families, their composition, and certificates."""
