"""Terms that a user defines: a membrane law, a condition, a force."""
