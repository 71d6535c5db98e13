"""Arms, each a folder of its own."""
