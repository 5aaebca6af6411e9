"""Time integrators. Each file is one rule that takes one step."""
