"""A bonded nylon textile, drawn at five angles to its grain."""
