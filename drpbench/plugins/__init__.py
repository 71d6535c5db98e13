"""How policies come in: by name, import path, entry point, from the host or from another
process."""
