"""Contact of the cloth with rigid obstacles."""
